// Local controllers with references to the caller's arrays.
#pragma once

#include "arrays.hpp"
#include "control/local_control.hpp"

struct BoundControl {
    adrl::LocalControl native;
    int num_threads;
    nb::object keep_alive;
};
