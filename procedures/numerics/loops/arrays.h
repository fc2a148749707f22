// NumPy arrays as arguments of the loops: contiguous and of one type.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstdint>
#include <vector>

namespace py = pybind11;

template <class T>
using Array = py::array_t<T, py::array::c_style>;
using Complex = std::complex<double>;
using Complex64 = std::complex<float>;

// Loops under VECTORS are compiled for AVX2 too, and the loader of the system chooses.
#if defined(__x86_64__) && defined(__GNUC__) && defined(__GLIBC__)
#define VECTORS __attribute__((target_clones("arch=x86-64-v3", "default")))
#else
#define VECTORS
#endif

#if defined(_MSC_VER)
#define INLINE static __forceinline
#else
#define INLINE static inline __attribute__((always_inline))
#endif

template <class T>
Array<T> array_of(const std::vector<T>& values) {
    return Array<T>(static_cast<py::ssize_t>(values.size()), values.data());
}
