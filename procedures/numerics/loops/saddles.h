// The loops of saddles.py in C++; they are documented there.
#pragma once

#include "arrays.h"

#include <limits>
#include <memory>

namespace {

constexpr int REACH = 4;  // radius of the filters

struct Filters {  // a Gaussian and its first two derivatives, right halves
    float g[REACH + 1], d[REACH + 1], dd[REACH + 1];
};

VECTORS void filter_rows(const float* const* above, const float* const* below, py::ssize_t n, const Filters& filters,
                         float* __restrict vg, float* __restrict vd, float* __restrict vdd) {
    const float *g = filters.g, *d = filters.d, *dd = filters.dd;
    const float *middle = above[0], *a1 = above[1], *a2 = above[2], *a3 = above[3], *a4 = above[4];
    const float *b1 = below[1], *b2 = below[2], *b3 = below[3], *b4 = below[4];
    for (py::ssize_t j = 0; j < n; j++) {
        const float s1 = a1[j] + b1[j], s2 = a2[j] + b2[j], s3 = a3[j] + b3[j], s4 = a4[j] + b4[j];
        vg[j] = g[0] * middle[j] + g[1] * s1 + g[2] * s2 + g[3] * s3 + g[4] * s4;
        vdd[j] = dd[0] * middle[j] + dd[1] * s1 + dd[2] * s2 + dd[3] * s3 + dd[4] * s4;
        vd[j] = d[1] * (b1[j] - a1[j]) + d[2] * (b2[j] - a2[j]) + d[3] * (b3[j] - a3[j]) + d[4] * (b4[j] - a4[j]);
    }
}

void down(const float* image, py::ssize_t rows, py::ssize_t n, py::ssize_t y, const Filters& filters, float* v) {
    const float *above[REACH + 1], *below[REACH + 1];
    for (py::ssize_t t = 0; t <= REACH; t++) {
        above[t] = image + std::abs(y - t) * n;
        below[t] = image + (rows - 1 - std::abs(rows - 1 - y - t)) * n;
    }
    const py::ssize_t wide = n + 2 * REACH;
    filter_rows(above, below, n, filters, v + REACH, v + wide + REACH, v + 2 * wide + REACH);
    for (float* row = v; row < v + 3 * wide; row += wide)
        for (int t = 1; t <= REACH; t++) row[REACH - t] = row[REACH + t], row[n + 3 + t] = row[n + 3 - t];
}

VECTORS void across(const float* v, py::ssize_t n, const Filters& filters, float flat, float least,
                    float* __restrict determinant, float* __restrict half, float* __restrict xy,
                    uint8_t* __restrict fit) {
    const float *a = v + REACH, *b = a + n + 2 * REACH, *c = b + n + 2 * REACH;
    const float *g = filters.g, *d = filters.d, *dd = filters.dd;
    for (py::ssize_t i = 0; i < n; i++) {
        const float xx = dd[0] * a[i] + dd[1] * (a[i - 1] + a[i + 1]) + dd[2] * (a[i - 2] + a[i + 2]) +
                         dd[3] * (a[i - 3] + a[i + 3]) + dd[4] * (a[i - 4] + a[i + 4]);
        const float yy = g[0] * c[i] + g[1] * (c[i - 1] + c[i + 1]) + g[2] * (c[i - 2] + c[i + 2]) +
                         g[3] * (c[i - 3] + c[i + 3]) + g[4] * (c[i - 4] + c[i + 4]);
        const float cross = d[1] * (b[i + 1] - b[i - 1]) + d[2] * (b[i + 2] - b[i - 2]) +
                            d[3] * (b[i + 3] - b[i - 3]) + d[4] * (b[i + 4] - b[i - 4]);
        const float mean = 0.5f * (xx + yy), difference = 0.5f * (xx - yy);
        const float squared = difference * difference + cross * cross;
        half[i] = difference, xy[i] = cross, determinant[i] = squared - mean * mean;
        fit[i] = (mean * mean < flat * squared) & (squared > least);
    }
}

VECTORS void peaks(const float* above, const float* here, const float* below, uint8_t* __restrict fit,
                   py::ssize_t n) {
    for (py::ssize_t j = 0; j < n; j++) {
        const float p = here[j + 1];
        fit[j] &= (p >= above[j]) & (p >= above[j + 1]) & (p >= above[j + 2]) & (p >= below[j]) & (p >= below[j + 1]) &
                  (p >= below[j + 2]) & (p >= here[j]) & (p >= here[j + 2]);
    }
}

py::tuple saddle_points(const Array<float>& image, const Array<float>& kernels, double flatter, double weakest) {
    const py::ssize_t rows = image.shape(0), n = image.shape(1);
    Filters filters;
    std::copy_n(kernels.data(), REACH + 1, filters.g), std::copy_n(kernels.data() + REACH + 1, REACH + 1, filters.d);
    std::copy_n(kernels.data() + 2 * (REACH + 1), REACH + 1, filters.dd);
    std::vector<int64_t> index;
    std::vector<float> halves, crosses;
    {
        const py::gil_scoped_release others;
        const auto flat = static_cast<float>(flatter * flatter), least = static_cast<float>(weakest * weakest);
        std::vector<float> v(3 * (n + 2 * REACH)), half(2 * n), xy(2 * n);
        std::vector<float> determinant(3 * (n + 2), std::numeric_limits<float>::lowest());
        std::vector<uint8_t> fit(2 * n);
        const auto row = [&](py::ssize_t y) { return determinant.data() + (y + 3) % 3 * (n + 2); };
        for (py::ssize_t y = 0; y <= rows; y++) {
            const py::ssize_t now = y % 2 * n, before = n - now;
            if (y < rows) {
                down(image.data(), rows, n, y, filters, v.data());
                across(v.data(), n, filters, flat, least, row(y) + 1, &half[now], &xy[now], &fit[now]);
            } else {
                std::fill_n(row(y), n + 2, std::numeric_limits<float>::lowest());
            }
            if (y == 0) continue;
            peaks(row(y - 2), row(y - 1), row(y), &fit[before], n);
            for (py::ssize_t j = 0; j < n; j++)
                if (fit[before + j]) {
                    index.push_back((y - 1) * n + j);
                    halves.push_back(half[before + j]), crosses.push_back(xy[before + j]);
                }
        }
    }
    return py::make_tuple(array_of(index), array_of(halves), array_of(crosses));
}

Array<float> ring_purity(const Array<float>& image, const Array<int64_t>& index, double radius, double off_centre) {
    const py::ssize_t rows = image.shape(0), columns = image.shape(1);
    Array<float> out(index.size());
    float* purity = out.mutable_data();
    const py::gil_scoped_release others;
    const float* picture = image.data();
    py::ssize_t left[8], upper[8];
    float fx[8], fy[8], v[8];
    for (int t = 0; t < 8; t++) {
        const double angle = t * 3.14159265358979323846 / 4, dx = radius * std::cos(angle), dy = radius * std::sin(angle);
        left[t] = static_cast<py::ssize_t>(std::floor(dx)), upper[t] = static_cast<py::ssize_t>(std::floor(dy));
        fx[t] = static_cast<float>(dx - left[t]), fy[t] = static_cast<float>(dy - upper[t]);
    }
    const auto inside = [](py::ssize_t i, py::ssize_t count) { return std::clamp<py::ssize_t>(i, 0, count - 1); };
    const float r = std::sqrt(0.5f);
    for (py::ssize_t n = 0; n < index.size(); n++) {
        const py::ssize_t row = index.data()[n] / columns, column = index.data()[n] % columns;
        float mean = 0, square = 0;
        for (int t = 0; t < 8; t++) {
            const py::ssize_t i = row + upper[t], j = column + left[t];
            const float *one = picture + inside(i, rows) * columns, *two = picture + inside(i + 1, rows) * columns;
            const py::ssize_t j0 = inside(j, columns), j1 = inside(j + 1, columns);
            const float a = one[j0] + fx[t] * (one[j1] - one[j0]), b = two[j0] + fx[t] * (two[j1] - two[j0]);
            v[t] = a + fy[t] * (b - a);
        }
        for (const float one : v) mean += one / 8;
        for (const float one : v) square += (one - mean) * (one - mean);
        const float p = v[0] - v[4], q = v[1] - v[5], u = v[2] - v[6], w = v[3] - v[7];
        const float cosine = p + r * (q - w), sine = u + r * (q + w);
        const float even = v[0] + v[4] - v[2] - v[6], odd = v[1] + v[5] - v[3] - v[7];
        const float rest = square - static_cast<float>(off_centre / 4) * (cosine * cosine + sine * sine);
        purity[n] = (even * even + odd * odd) / 4 / std::max(rest, 1e-30f);
    }
    return out;
}

Array<int64_t> best_of_tiles(const Array<int64_t>& index, std::pair<int64_t, int64_t> shape,
                             const Array<double>& merits, int64_t side, int64_t most) {
    const int64_t across = (shape.second - 1) / side + 1, tiles = ((shape.first - 1) / side + 1) * across;
    const auto count = static_cast<int64_t>(index.size());
    std::vector<int64_t> best;
    {
        const py::gil_scoped_release others;
        std::vector<int64_t> starts(tiles + 1), tile_of(count), crowds(side * side + 1), held(tiles);
        for (int64_t n = 0; n < count; n++) {
            const int64_t pixel = index.data()[n];
            tile_of[n] = pixel / shape.second / side * across + pixel % shape.second / side;
            starts[tile_of[n] + 1]++;
        }
        for (int64_t tile = 0; tile < tiles; tile++) crowds[starts[tile + 1]]++;
        int64_t each = 0, more = tiles;
        for (int64_t kept = 0; kept < std::min(most, count); each++) {
            more -= crowds[each];  // number of tiles with another pixel
            kept += more;
        }
        for (int64_t tile = 0; tile < tiles; tile++) starts[tile + 1] = starts[tile] + std::min(starts[tile + 1], each);
        best.resize(starts[tiles]);
        const double* merit = merits.data();
        for (int64_t n = 0; n < count; n++) {
            const int64_t tile = tile_of[n], room = starts[tile + 1] - starts[tile];
            int64_t* own = best.data() + starts[tile];
            int64_t m = held[tile];
            if (m < room) {
                held[tile]++;
                for (; m > 0 && merit[own[m - 1]] > merit[n]; m--) own[m] = own[m - 1];
                own[m] = n;
            } else if (room > 0 && merit[n] > merit[own[0]]) {
                for (m = 0; m + 1 < room && merit[own[m + 1]] < merit[n]; m++) own[m] = own[m + 1];
                own[m] = n;
            }
        }
    }
    return array_of(best);
}

}  // namespace

inline void define_saddles(py::module_& module) {
    module.def("saddle_points", &saddle_points);
    module.def("ring_purity", &ring_purity);
    module.def("best_of_tiles", &best_of_tiles);
}
