// Local controllers with references to the caller's arrays.
#pragma once

#include "arrays.hpp"
#include "control/local_control.hpp"
#include "kinds.hpp"

struct BoundControl {
    adrl::LocalControl native;
    int num_threads;
    bool in_known_worlds_alone; // one of the controllers does not drive on a map of the robot's own
    nb::object keep_alive;

    void require_kinds_known() const {
        require_kinds(native.kinds(), static_cast<std::size_t>(native.num_robots()), native.num_kinds());
    }
};
