// The loops of matrices.py in C++; they are documented there.
#pragma once

#include "arrays.h"

namespace {

VECTORS void fill_rows(float* A, py::ssize_t width, const float* raster, py::ssize_t length, const int64_t* rows,
                       const int64_t* columns, const float* weight, py::ssize_t m, py::ssize_t s, py::ssize_t k) {
    for (py::ssize_t p = 0; p < m; p++) {
        const float w = weight[p];
        const float* last = raster + (s * rows[p] + k - 1) * length + s * columns[p] + k - 1;
        for (py::ssize_t i = 0; i < k; i++)
            for (py::ssize_t j = 0; j < k; j++) A[p * width + i * k + j] = w * last[-i * length - j];
    }
}

void fill_convolution(Array<float>& A, const Array<float>& raster, const Array<int64_t>& rows, const Array<int64_t>& columns,
          const Array<float>& weight, py::ssize_t s, py::ssize_t k) {
    float* first = A.mutable_data();
    const py::gil_scoped_release others;
    fill_rows(first, A.shape(1), raster.data(), raster.shape(1), rows.data(), columns.data(), weight.data(),
              rows.size(), s, k);
}

VECTORS void convolve_rows(const float* raster, py::ssize_t length, const int64_t* rows, const int64_t* columns,
                           py::ssize_t m, const float* turned, py::ssize_t k, py::ssize_t s, float* out) {
    for (py::ssize_t p = 0; p < m; p++) {
        const float* first = raster + s * rows[p] * length + s * columns[p];
        float total = 0;
        for (py::ssize_t i = 0; i < k; i++)
            for (py::ssize_t j = 0; j < k; j++) total += turned[i * k + j] * first[i * length + j];
        out[p] = total;
    }
}

Array<float> convolve_at(const Array<float>& raster, const Array<int64_t>& rows, const Array<int64_t>& columns,
                         const Array<float>& h, py::ssize_t s) {
    Array<float> out(rows.size());
    float* values = out.mutable_data();
    const py::gil_scoped_release others;
    const std::vector<float> turned(std::reverse_iterator(h.data() + h.size()), std::reverse_iterator(h.data()));
    convolve_rows(raster.data(), raster.shape(1), rows.data(), columns.data(), rows.size(), turned.data(), h.shape(0), s,
                  values);
    return out;
}

VECTORS void add_rows(const float* A, py::ssize_t m, py::ssize_t n, const int64_t* group, const float* factor,
                      float* out) {
    for (py::ssize_t p = 0; p < m; p++)
        for (py::ssize_t j = 0; j < n; j++) out[group[p] * n + j] += factor[p] * A[p * n + j];
}

Array<float> sums_of_groups(const Array<float>& A, const Array<int64_t>& group, const Array<float>& factor,
                            py::ssize_t count) {
    Array<float> out({count, A.shape(1)});
    float* sums = out.mutable_data();
    const py::gil_scoped_release others;
    std::fill_n(sums, out.size(), 0.0f);
    add_rows(A.data(), A.shape(0), A.shape(1), group.data(), factor.data(), sums);
    return out;
}

template <class T>
INLINE void substitute(const T* L, T* x, py::ssize_t n) {
    for (py::ssize_t i = 0; i < n; i++) {
        T total = x[i];
        for (py::ssize_t j = 0; j < i; j++) total -= L[i * n + j] * x[j];
        x[i] = total / L[i * n + i];
    }
    for (py::ssize_t i = n; i-- > 0;) {
        x[i] /= L[i * n + i];
        for (py::ssize_t j = 0; j < i; j++) x[j] -= L[i * n + j] * x[i];
    }
}

template <class T>
INLINE void invert(const T* L, T* X, py::ssize_t n) {
    std::fill_n(X, n * n, T(0));
    for (py::ssize_t i = 0; i < n; i++) {
        T* row = X + i * n;
        for (py::ssize_t m = 0; m < i; m++)
            for (py::ssize_t j = 0; j <= m; j++) row[j] -= L[i * n + m] * X[m * n + j];
        for (py::ssize_t j = 0; j < i; j++) row[j] /= L[i * n + i];
        row[i] = 1 / L[i * n + i];
    }
}

VECTORS void substitute_in(const float* L, float* x, py::ssize_t n) { substitute(L, x, n); }
VECTORS void substitute_in(const double* L, double* x, py::ssize_t n) { substitute(L, x, n); }
VECTORS void invert_to(const float* L, float* X, py::ssize_t n) { invert(L, X, n); }
VECTORS void invert_to(const double* L, double* X, py::ssize_t n) { invert(L, X, n); }

template <class T>
Array<T> substituted(const Array<T>& L, const Array<T>& b) {
    Array<T> x(b.size(), b.data());
    T* values = x.mutable_data();
    const py::gil_scoped_release others;
    substitute_in(L.data(), values, b.size());
    return x;
}

template <class T>
Array<T> inverted(const Array<T>& L) {
    Array<T> X({L.shape(0), L.shape(0)});
    T* values = X.mutable_data();
    const py::gil_scoped_release others;
    invert_to(L.data(), values, L.shape(0));
    return X;
}

}  // namespace

inline void define_matrices(py::module_& module) {
    module.def("fill_convolution", &fill_convolution, py::arg("A").noconvert(), py::arg("raster"), py::arg("rows"), py::arg("columns"),
               py::arg("weight"), py::arg("s"), py::arg("k"));
    module.def("convolve_at", &convolve_at);
    module.def("sums_of_groups", &sums_of_groups);
    module.def("substituted", &substituted<float>);
    module.def("substituted", &substituted<double>);
    module.def("inverted", &inverted<float>);
    module.def("inverted", &inverted<double>);
}
