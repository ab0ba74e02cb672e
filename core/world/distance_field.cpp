#include "world/distance_field.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "clones.hpp"

namespace adrl {
namespace {

// Larger than any distance in a bitmap, small enough that its square stays exact in a double.
constexpr std::int32_t kFar = 1 << 24;

// Distance to the nearest solid cell of the same column, scanning rows so that columns go side by side.
ADRL_CLONES void scan_columns(const std::uint8_t *solid, int height, int width, std::int32_t *column) {
    for (int x = 0; x < width; ++x) column[x] = solid[x] ? 0 : kFar;
    for (int y = 1; y < height; ++y) {
        const std::int32_t *above = column + static_cast<std::ptrdiff_t>(y - 1) * width;
        std::int32_t *here = column + static_cast<std::ptrdiff_t>(y) * width;
        const std::uint8_t *cells = solid + static_cast<std::ptrdiff_t>(y) * width;
        for (int x = 0; x < width; ++x) here[x] = cells[x] ? 0 : std::min(above[x] + 1, kFar);
    }
    for (int y = height - 2; y >= 0; --y) {
        const std::int32_t *below = column + static_cast<std::ptrdiff_t>(y + 1) * width;
        std::int32_t *here = column + static_cast<std::ptrdiff_t>(y) * width;
        for (int x = 0; x < width; ++x) here[x] = std::min(here[x], below[x] + 1);
    }
}

// One row: out[x] = min over q of (x - q)^2 + column[q]^2.
class Envelope {
  public:
    explicit Envelope(int width) : site_(width), height_(width), start_(width + 1) {}

    void distances(const std::int32_t *column, int width, float *out) {
        int last = -1;
        for (int q = 0; q < width; ++q) {
            if (column[q] >= kFar) continue;
            const double h = static_cast<double>(column[q]) * column[q] + static_cast<double>(q) * q;
            double from = -std::numeric_limits<double>::infinity();
            while (last >= 0) {
                from = (h - height_[last]) / (2.0 * (q - site_[last]));
                if (from > start_[last]) break;
                from = -std::numeric_limits<double>::infinity();
                --last;
            }
            ++last;
            site_[last] = q;
            height_[last] = h;
            start_[last] = from;
        }
        if (last < 0) {
            std::fill(out, out + width, std::numeric_limits<float>::infinity());
            return;
        }
        start_[last + 1] = std::numeric_limits<double>::infinity();
        int k = 0;
        for (int x = 0; x < width; ++x) {
            while (start_[k + 1] < x) ++k;
            const double dx = x - site_[k];
            const double dy = column[site_[k]];
            out[x] = static_cast<float>(std::sqrt(dx * dx + dy * dy));
        }
    }

  private:
    std::vector<int> site_;
    std::vector<double> height_;
    std::vector<double> start_;
};

} // namespace

void distance_field(const std::uint8_t *solid, int height, int width, float *out) {
    if (height == 0 || width == 0) return;
    std::vector<std::int32_t> column(static_cast<std::size_t>(height) * width);
    scan_columns(solid, height, width, column.data());
    Envelope envelope(width);
    for (int y = 0; y < height; ++y) {
        const auto row = static_cast<std::ptrdiff_t>(y) * width;
        envelope.distances(column.data() + row, width, out + row);
    }
}

void chebyshev_field(const std::uint8_t *solid, int height, int width, std::uint8_t *out) {
    auto at = [&](int y, int x) -> int {
        return y < 0 || x < 0 || y >= height || x >= width ? 0 : out[static_cast<std::ptrdiff_t>(y) * width + x];
    };
    for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
            const auto i = static_cast<std::ptrdiff_t>(y) * width + x;
            const int near =
                std::min(std::min(at(y - 1, x - 1), at(y - 1, x)), std::min(at(y - 1, x + 1), at(y, x - 1)));
            out[i] = static_cast<std::uint8_t>(solid[i] ? 0 : std::min(near + 1, 255));
        }
    }
    for (int y = height - 1; y >= 0; --y) {
        for (int x = width - 1; x >= 0; --x) {
            const auto i = static_cast<std::ptrdiff_t>(y) * width + x;
            const int near =
                std::min(std::min(at(y + 1, x + 1), at(y + 1, x)), std::min(at(y + 1, x - 1), at(y, x + 1)));
            out[i] = static_cast<std::uint8_t>(std::min<int>(out[i], near + 1));
        }
    }
}

} // namespace adrl
