// The loops of splines.py in C++; they are documented there.
#pragma once

#include "arrays.h"

namespace {

INLINE void cubic_weights(float t, float* __restrict w, py::ssize_t stride) {
    const float a = 1.0f - t;
    const float w0 = a * a * a * (1.0f / 6), w3 = t * t * t * (1.0f / 6);
    const float w1 = 2.0f / 3 - t * t * (1.0f - 0.5f * t);
    w[0] = w0, w[stride] = w1, w[2 * stride] = 1.0f - w0 - w1 - w3, w[3 * stride] = w3;
}

struct Map {
    double H[9], centre[2], radius, displacement[18], start[2], step;
};

VECTORS void read_rows(const float* flat, py::ssize_t n_y, py::ssize_t n_x, const Map& map, float* out, py::ssize_t rows,
                       py::ssize_t columns) {
    std::vector<float> weights(8 * columns), sums(4 * columns), places(2 * columns);
    std::vector<int32_t> firsts(columns);
    float *__restrict down = weights.data(), *__restrict across = down + 4 * columns, *__restrict sum = sums.data();
    float *__restrict t_x = places.data(), *__restrict t_y = t_x + columns;
    int32_t* __restrict first = firsts.data();
    const double *H = map.H, *c = map.displacement, *d = c + 9, radius = map.radius;
    for (py::ssize_t i = 0; i < rows; i++) {
        const double py = map.start[1] + i * map.step, y = (py - map.centre[1]) / radius;
        const double u0 = y * (c[1] + y * (c[4] + y * c[8])), v0 = y * (d[1] + y * (d[4] + y * d[8]));
        const double u1 = c[0] + y * (c[3] + y * c[7]), v1 = d[0] + y * (d[3] + y * d[7]);
        const double u2 = c[2] + y * c[6], v2 = d[2] + y * d[6], u3 = c[5], v3 = d[5];
        const double last_x = n_x - 2.001, last_y = n_y - 2.001;
        for (int j = 0; j < columns; j++) {
            const double px = map.start[0] + j * map.step, x = (px - map.centre[0]) / radius;
            const double qx = px + u0 + x * (u1 + x * (u2 + x * u3)), qy = py + v0 + x * (v1 + x * (v2 + x * v3));
            const double w = 1.0 / (H[6] * qx + H[7] * qy + H[8]);
            double gx = (H[0] * qx + H[1] * qy + H[2]) * w, gy = (H[3] * qx + H[4] * qy + H[5]) * w;
            gx = gx > 1.0 ? gx : 1.0, gy = gy > 1.0 ? gy : 1.0;
            gx = gx < last_x ? gx : last_x, gy = gy < last_y ? gy : last_y;
            const int ix = static_cast<int>(gx), iy = static_cast<int>(gy);
            t_x[j] = static_cast<float>(gx - ix), t_y[j] = static_cast<float>(gy - iy);
            first[j] = (iy - 1) * static_cast<int>(n_x) + ix - 1;
        }
        for (py::ssize_t j = 0; j < columns; j++) cubic_weights(t_y[j], down + j, columns);
        for (py::ssize_t j = 0; j < columns; j++) cubic_weights(t_x[j], across + j, columns);
        for (py::ssize_t j = 0; j < columns; j++) {
            const float *a = flat + first[j], *b = a + n_x, *e = b + n_x, *f = e + n_x;
            const float y0 = down[j], y1 = down[columns + j], y2 = down[2 * columns + j], y3 = down[3 * columns + j];
            float s[4];
            for (int m = 0; m < 4; m++) s[m] = y0 * a[m];
            for (int m = 0; m < 4; m++) s[m] += y1 * b[m];
            for (int m = 0; m < 4; m++) s[m] += y2 * e[m];
            for (int m = 0; m < 4; m++) s[m] += y3 * f[m];
            for (int m = 0; m < 4; m++) sum[4 * j + m] = s[m];
        }
        for (py::ssize_t j = 0; j < columns; j++) {
            const float left = across[j] * sum[4 * j] + across[columns + j] * sum[4 * j + 1];
            out[i * columns + j] =
                left + across[2 * columns + j] * sum[4 * j + 2] + across[3 * columns + j] * sum[4 * j + 3];
        }
    }
}

Array<float> read_spline(const Array<float>& coefficients, const Array<double>& H, const Array<double>& centre, double radius,
                  const Array<double>& displacement, const Array<double>& start, double step,
                  std::pair<py::ssize_t, py::ssize_t> shape) {
    Map map;
    std::copy_n(H.data(), 9, map.H), std::copy_n(displacement.data(), 18, map.displacement);
    std::copy_n(centre.data(), 2, map.centre), std::copy_n(start.data(), 2, map.start);
    map.radius = radius, map.step = step;
    Array<float> out({shape.first, shape.second});
    float* values = out.mutable_data();
    const py::gil_scoped_release others;
    read_rows(coefficients.data(), coefficients.shape(0), coefficients.shape(1), map, values, shape.first, shape.second);
    return out;
}

INLINE Complex64 times(Complex64 a, Complex64 b) {  // of finite numbers
    return {a.real() * b.real() - a.imag() * b.imag(), a.real() * b.imag() + a.imag() * b.real()};
}

VECTORS void add_band(Array<Complex64>& cut, const Array<Complex64>& spectrum, const Array<Complex64>& filter_y,
                      const Array<Complex64>& filter_x, const Array<double>& J, double limit) {
    const py::ssize_t size = cut.shape(0), width = cut.shape(1), n = spectrum.shape(0), count = filter_x.size();
    const double *j = J.data(), bound = limit * n;
    Complex64* first = cut.mutable_data();
    const py::gil_scoped_release others;
    for (py::ssize_t i = 0; i < filter_y.size(); i++) {
        const py::ssize_t ky = i - filter_y.size() / 2;
        Complex64* row = first + (ky < 0 ? ky + size : ky) * width;
        const Complex64 *line = spectrum.data() + ((ky % n + n) % n) * n, *along_x = filter_x.data();
        const Complex64 along_y = filter_y.data()[i];
        for (py::ssize_t from = 0; from < count; from += n)
            for (py::ssize_t kx = from; kx < std::min(from + n, count); kx++)
                if (std::abs(j[0] * kx + j[2] * ky) <= bound && std::abs(j[1] * kx + j[3] * ky) <= bound)
                    row[kx] += times(times(line[kx - from], along_y), along_x[kx]);
    }
}

VECTORS void add_products(float* out, const float* values, const float* factors, py::ssize_t count) {
    for (py::ssize_t j = 0; j < count; j++) {
        out[2 * j] += values[2 * j] * factors[j];
        out[2 * j + 1] += values[2 * j + 1] * factors[j];
    }
}

Array<Complex64> folded_product(const Array<Complex64>& seen, const Array<float>& spectrum, py::ssize_t s) {
    const py::ssize_t rows = seen.shape(0) / s, columns = seen.shape(1);
    Array<Complex64> out({rows, columns});
    auto* sums = reinterpret_cast<float*>(out.mutable_data());
    const auto* values = reinterpret_cast<const float*>(seen.data());
    const py::gil_scoped_release others;
    std::fill_n(sums, 2 * rows * columns, 0.0f);
    for (py::ssize_t i = 0; i < seen.shape(0); i++)
        add_products(sums + 2 * (i % rows) * columns, values + 2 * i * columns, spectrum.data() + i * columns, columns);
    return out;
}

}  // namespace

inline void define_splines(py::module_& module) {
    module.def("read_spline", &read_spline);
    module.def("add_band", &add_band, py::arg("cut").noconvert(), py::arg("spectrum"), py::arg("filter_y"),
               py::arg("filter_x"), py::arg("J"), py::arg("limit"));
    module.def("folded_product", &folded_product);
}
