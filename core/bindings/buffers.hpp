// Arrays that kernels keep: handed over in a dictionary, checked once.
#pragma once

#include <algorithm>
#include <string>

#include "arrays.hpp"

// The caller's array of this name; anything but a writable C-contiguous array of this dtype and shape is refused.
template <class T>
T *buffer(const nb::dict &buffers, const char *name, std::initializer_list<std::size_t> shape) {
    if (!buffers.contains(name)) throw nb::key_error(name);
    Out<T> array;
    const std::string label = std::string("buffer ") + name;
    if (!nb::try_cast(buffers[name], array, false) || !array.is_valid()) {
        throw nb::type_error((label + ": give a writable C-contiguous array of the documented dtype").c_str());
    }
    if (!std::equal(shape.begin(), shape.end(), array.shape_ptr(), array.shape_ptr() + array.ndim())) {
        std::string wanted;
        for (const std::size_t n : shape) wanted += (wanted.empty() ? "" : ", ") + std::to_string(n);
        throw nb::value_error((label + ": its shape is not (" + wanted + ")").c_str());
    }
    return array.data();
}
