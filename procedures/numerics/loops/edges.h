// The loops of edges.py in C++; they are documented there.
#pragma once

#include "arrays.h"

namespace {

struct Columns {  // one direction: values (m, width), first line of each sample, number of lines
    const float* values;
    const int32_t* first;
    py::ssize_t width, lines;

    Columns(const Array<float>& values, const Array<int32_t>& first, py::ssize_t lines)
        : values(values.data()), first(first.data()), width(values.shape(1)), lines(lines) {}
    const float* row(py::ssize_t p) const { return values + p * width; }
    py::ssize_t count(py::ssize_t p) const { return std::min(width, lines - first[p]); }
};

VECTORS void see(const Columns& vertical, const Columns& horizontal, const float* offsets, float* out, py::ssize_t m) {
    for (py::ssize_t p = 0; p < m; p++) {
        float total = 0;
        const float *a = offsets + vertical.first[p], *b = offsets + vertical.lines + horizontal.first[p];
        for (py::ssize_t n = 0; n < vertical.count(p); n++) total += vertical.row(p)[n] * a[n];
        for (py::ssize_t n = 0; n < horizontal.count(p); n++) total += horizontal.row(p)[n] * b[n];
        out[p] = total;
    }
}

VECTORS void add_back(const Columns& vertical, const Columns& horizontal, const float* samples, float* out,
                      py::ssize_t m) {
    for (py::ssize_t p = 0; p < m; p++) {
        float *a = out + vertical.first[p], *b = out + vertical.lines + horizontal.first[p];
        for (py::ssize_t n = 0; n < vertical.count(p); n++) a[n] += vertical.row(p)[n] * samples[p];
        for (py::ssize_t n = 0; n < horizontal.count(p); n++) b[n] += horizontal.row(p)[n] * samples[p];
    }
}

VECTORS void add_gram(const Columns& vertical, const Columns& horizontal, float* G, py::ssize_t m) {
    const py::ssize_t lines = vertical.lines;
    for (py::ssize_t p = 0; p < m; p++) {
        const float *v = vertical.row(p), *h = horizontal.row(p);
        const py::ssize_t i = vertical.first[p], j = lines + horizontal.first[p], across = vertical.count(p);
        for (py::ssize_t a = 0; a < across; a++)
            for (py::ssize_t b = 0; b <= a; b++) G[(i + a) * 2 * lines + i + b] += v[a] * v[b];
        for (py::ssize_t a = 0; a < horizontal.count(p); a++) {
            float* row = G + (j + a) * 2 * lines;
            for (py::ssize_t b = 0; b < across; b++) row[i + b] += h[a] * v[b];
            for (py::ssize_t b = 0; b <= a; b++) row[j + b] += h[a] * h[b];
        }
    }
}

Array<float> apply_edges(const Array<float>& vertical, const Array<int32_t>& first_vertical, const Array<float>& horizontal,
                  const Array<int32_t>& first_horizontal, const Array<float>& offsets) {
    const py::ssize_t m = vertical.shape(0), lines = offsets.size() / 2;
    Array<float> out(m);
    float* values = out.mutable_data();
    const py::gil_scoped_release others;
    see({vertical, first_vertical, lines}, {horizontal, first_horizontal, lines}, offsets.data(), values, m);
    return out;
}

Array<float> apply_edges_transposed(const Array<float>& vertical, const Array<int32_t>& first_vertical, const Array<float>& horizontal,
                  const Array<int32_t>& first_horizontal, const Array<float>& samples, py::ssize_t lines) {
    Array<float> out(2 * lines);
    float* values = out.mutable_data();
    const py::gil_scoped_release others;
    std::fill_n(values, out.size(), 0.0f);
    add_back({vertical, first_vertical, lines}, {horizontal, first_horizontal, lines}, samples.data(), values,
             vertical.shape(0));
    return out;
}

Array<float> edge_gram(const Array<float>& vertical, const Array<int32_t>& first_vertical, const Array<float>& horizontal,
                  const Array<int32_t>& first_horizontal, py::ssize_t lines) {
    Array<float> out({2 * lines, 2 * lines});
    float* values = out.mutable_data();
    const py::gil_scoped_release others;
    std::fill_n(values, out.size(), 0.0f);
    add_gram({vertical, first_vertical, lines}, {horizontal, first_horizontal, lines}, values, vertical.shape(0));
    return out;
}

std::pair<Array<float>, Array<int32_t>> edge_lines(const Array<double>& cells, const Array<float>& steps,
                                              const Array<float>& fine, const Array<double>& scale,
                                              const Array<double>& reach, int pieces, const Array<float>& weight) {
    const py::ssize_t m = cells.shape(0), n = steps.shape(1), last = fine.shape(0), middle = last / 2;
    const double *scales = scale.data(), x_reach = reach.data()[0], y_reach = reach.data()[1];
    const py::ssize_t width = 2 * static_cast<py::ssize_t>(std::ceil(x_reach)) + 1;
    Array<float> values({m, width});
    Array<int32_t> first(m);
    float* value = values.mutable_data();
    int32_t* begin = first.mutable_data();
    const double step_x = scales[1] / pieces, step_y = scales[3] / pieces;
    const py::gil_scoped_release others;
    std::fill_n(value, m * width, 0.0f);
    for (py::ssize_t p = 0; p < m; p++) {
        const double u = cells.data()[2 * p], v = cells.data()[2 * p + 1];
        const auto j0 = std::min(std::max(static_cast<py::ssize_t>(std::floor(u - x_reach)), py::ssize_t(0)), n);
        const auto i0 = std::max(static_cast<py::ssize_t>(v - y_reach), py::ssize_t(0));
        const auto i1 = std::min(static_cast<py::ssize_t>(v + y_reach) + 1, n);
        begin[p] = static_cast<int32_t>(j0);
        for (py::ssize_t j = j0; j < std::min(j0 + width, n + 1); j++) {
            double x = scales[0] * (u - j) + scales[1] * (v - i0 - 0.5 / pieces) + middle + 0.5;
            double y = scales[2] * (u - j) + scales[3] * (v - i0 - 0.5 / pieces) + middle + 0.5;
            float total = 0;
            const float* line = steps.data() + j * n;
            for (py::ssize_t i = i0; i < i1; i++)
                for (int piece = 0; piece < pieces; piece++, x -= step_x, y -= step_y)
                    if (x >= 0 && y >= 0 && x < last && y < last)
                        total += line[i] * fine.data()[static_cast<int>(y) * last + static_cast<int>(x)];
            value[p * width + j - j0] = total * weight.data()[p] / pieces;
        }
    }
    return {values, first};
}

}  // namespace

inline void define_edges(py::module_& module) {
    module.def("apply_edges", &apply_edges);
    module.def("apply_edges_transposed", &apply_edges_transposed);
    module.def("edge_gram", &edge_gram);
    module.def("edge_lines", &edge_lines);
}
