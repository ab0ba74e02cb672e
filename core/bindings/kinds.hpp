// Rows that belong to robots of several kinds: which kind each row is, by its number.
#pragma once

#include <cstdint>
#include <string>

#include "arrays.hpp"

using Kinds = In<std::int64_t, nb::shape<-1>>;

// One of `count` kinds for each of n rows.
inline void require_kinds(const std::int64_t *kind, std::size_t n, std::size_t count) {
    for (std::size_t i = 0; i < n; ++i) {
        if (kind[i] < 0 || kind[i] >= static_cast<std::int64_t>(count))
            throw nb::value_error(("kind: row " + std::to_string(i) + " is of kind " + std::to_string(kind[i]) +
                                   "; give 0 to " + std::to_string(count - 1))
                                      .c_str());
    }
}
