#include <nanobind/stl/tuple.h>

#include "arrays.hpp"
#include "world/misfit.hpp"

using namespace adrl;

namespace {

using Ranges = In<double, nb::shape<-1>>;
using FanOf = std::tuple<double, double, double>; // first angle, increment, greatest range

Fan make_fan(const Ranges &ranges, const FanOf &of) {
    const auto [angle_min, increment, max_range] = of;
    require_finite({angle_min, increment, max_range}, "fan");
    if (increment == 0.0) throw nb::value_error("fan: its increment is 0");
    return {view(ranges), angle_min, increment, max_range};
}

Returned<double> misfits(const Ranges &seen, const FanOf &seen_fan, const Ranges &surface, const FanOf &surface_fan,
                         const In<double, Rows3> &motions, double scale, int stride) {
    const Fan fan = make_fan(seen, seen_fan), under = make_fan(surface, surface_fan);
    require_all_finite(motions, "motions");
    if (!(scale > 0.0) || stride < 1) throw nb::value_error("scale_m or stride is not positive");
    double *out = nullptr;
    auto result = new_array<double>({motions.shape(0), 2}, out);
    const nb::gil_scoped_release release;
    const Overlay overlay(fan, under, scale, stride);
    for (std::size_t i = 0; i < motions.shape(0); ++i) {
        const Misfit found = overlay.misfit({motions(i, 0), motions(i, 1), motions(i, 2)});
        out[2 * i] = found.mean;
        out[2 * i + 1] = found.points;
    }
    return result;
}

} // namespace

void bind_misfit(nb::module_ &m) {
    m.def("misfits", &misfits, nb::arg("seen").noconvert(), nb::arg("seen_fan"), nb::arg("surface").noconvert(),
          nb::arg("surface_fan"), nb::arg("motions").noconvert(), nb::arg("scale_m"), nb::arg("stride") = 1);
}
