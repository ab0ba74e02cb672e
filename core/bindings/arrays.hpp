// numpy arrays in and out of the kernels: checked for dtype, shape and contiguity, never converted.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cmath>
#include <memory>
#include <span>
#include <string>

namespace nb = nanobind;

template <class T, class... Shape>
using In = nb::ndarray<const T, Shape..., nb::c_contig, nb::device::cpu>;
template <class T, class... Shape>
using Out = nb::ndarray<T, Shape..., nb::c_contig, nb::device::cpu>;
template <class T>
using Returned = nb::ndarray<nb::numpy, T>;

using Rows2 = nb::shape<-1, 2>;
using Rows3 = nb::shape<-1, 3>;
using Rows4 = nb::shape<-1, 4>;
using Rows8 = nb::shape<-1, 8>;

template <class Array>
auto view(const Array &array) {
    return std::span(array.data(), array.size());
}

// Kernels assume finite numbers: a NaN would lead them out of their arrays.
inline void require_finite(std::initializer_list<double> values, const char *name) {
    for (const double value : values) {
        if (!std::isfinite(value)) throw nb::value_error((std::string(name) + " is not finite").c_str());
    }
}

template <class Array>
void require_all_finite(const Array &array, const char *name) {
    for (const double value : view(array)) require_finite({value}, name);
}

// A new numpy array, filled by the caller through `data`, freed with the array.
template <class T>
Returned<T> new_array(std::initializer_list<std::size_t> shape, T *&data) {
    std::size_t size = 1;
    for (const std::size_t n : shape) size *= n;
    auto owned = std::make_unique<T[]>(std::max<std::size_t>(size, 1));
    data = owned.get();
    nb::capsule owner(owned.release(), [](void *p) noexcept { delete[] static_cast<T *>(p); });
    return Returned<T>(data, shape, owner);
}
