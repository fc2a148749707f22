// The loops of layouts.py in C++; they are documented there.
#pragma once

#include "arrays.h"

namespace {

constexpr double FAR = 1e9;

struct Rules {  // the fields of spatial_bins.LayoutRules, in order
    double min_step, max_step, along_axis, same_axis, same_merit, collinear, middle_radius, square, level_slope;
    int min_near, min_near_crowded;

    explicit Rules(const py::tuple& t)
        : min_step(number(t[0])), max_step(number(t[1])), along_axis(number(t[2])), same_axis(number(t[3])),
          same_merit(number(t[4])), collinear(number(t[5])), middle_radius(number(t[6])), square(number(t[7])),
          level_slope(number(t[8])), min_near(t[9].cast<int>()), min_near_crowded(t[10].cast<int>()) {}
    static double number(const py::handle& value) { return value.cast<double>(); }
};

INLINE double product(Complex a, Complex b) { return a.real() * b.real() + a.imag() * b.imag(); }

struct Field {  // the fields of spatial_bins.Field, in order
    Array<Complex> points_, axes_;
    Array<double> merits_;
    Array<int64_t> starts_;
    const Complex *points, *axes;
    const double* merits;
    const int64_t* starts;
    int64_t count, rows, columns;
    double left, top, side;

    explicit Field(const py::tuple& t)
        : points_(t[0].cast<Array<Complex>>()), axes_(t[1].cast<Array<Complex>>()), merits_(t[2].cast<Array<double>>()),
          starts_(t[3].cast<Array<int64_t>>()), points(points_.data()), axes(axes_.data()), merits(merits_.data()),
          starts(starts_.data()), count(points_.size()), rows(t[4].cast<int64_t>()), columns(t[5].cast<int64_t>()),
          left(t[6].cast<double>()), top(t[7].cast<double>()), side(t[8].cast<double>()) {}

    struct Bins {
        int64_t top, bottom, first, last;
    };

    Bins within(Complex place, double reach) const {
        if (!(std::norm(place) < FAR * FAR)) return {0, -1, 0, -1};
        const double x = (place.real() - left) / side, y = (place.imag() - top) / side, r = reach / side;
        const double upper = std::max(std::floor(y - r), 0.0), lower = std::min(std::floor(y + r), rows - 1.0);
        const double first = std::max(std::floor(x - r), 0.0), last = std::min(std::floor(x + r), columns - 1.0);
        if (last < first || lower < upper) return {0, -1, 0, -1};
        return {static_cast<int64_t>(upper), static_cast<int64_t>(lower), static_cast<int64_t>(first),
                static_cast<int64_t>(last)};
    }

    bool alike(int64_t i, int64_t j, const Rules& rules) const {
        return product(axes[i], axes[j]) > rules.same_axis && merits[i] < rules.same_merit * merits[j] &&
               merits[j] < rules.same_merit * merits[i];
    }

    int64_t nearest(Complex place, double reach, int64_t like, const Rules& rules) const {
        double best = reach * reach;
        int64_t found = -1;
        const Bins bins = within(place, reach);
        for (int64_t row = bins.top; row <= bins.bottom; row++) {
            const int64_t* start = starts + row * columns;
            for (int64_t n = start[bins.first]; n < start[bins.last + 1]; n++) {
                const double distance = std::norm(points[n] - place);
                if (distance <= best && alike(n, like, rules)) best = distance, found = n;
            }
        }
        return found;
    }

    bool is_step(int64_t i, int64_t j, const Rules& rules) const {
        const Complex d = points[j] - points[i];
        const double square = std::norm(d);
        if (square <= rules.min_step * rules.min_step || square >= rules.max_step * rules.max_step) return false;
        if (!alike(i, j, rules)) return false;
        const Complex axis = axes[i] + axes[j];
        const Complex squared = {d.real() * d.real() - d.imag() * d.imag(), 2 * d.real() * d.imag()};
        return std::abs(product(squared, axis)) > rules.along_axis * square * std::sqrt(std::norm(axis));
    }

    bool is_free(int64_t i, int64_t j, const Rules& rules) const {
        const double length = std::sqrt(std::norm(points[i] - points[j]));
        return nearest((points[i] + points[j]) / 2.0, rules.middle_radius * length, i, rules) < 0;
    }
};

Array<int64_t> all_nearest(const py::tuple& saddles, const Array<Complex>& places, const Array<double>& reaches,
                           const Array<int64_t>& likes, const py::tuple& limits) {
    const Field field(saddles);
    const Rules rules(limits);
    const py::ssize_t m = places.shape(1);
    Array<int64_t> out({places.shape(0), m});
    int64_t* found = out.mutable_data();
    const py::gil_scoped_release others;
    for (py::ssize_t n = 0; n < places.size(); n++)
        found[n] = field.nearest(places.data()[n], reaches.data()[n / m], likes.data()[n / m], rules);
    return out;
}

Array<bool> non_maximum_suppression(const py::tuple& saddles, double radius, double same_axis) {
    const Field field(saddles);
    Array<bool> out(field.count);
    bool* alone = out.mutable_data();
    const py::gil_scoped_release others;
    for (int64_t i = 0; i < field.count; i++) {
        alone[i] = true;
        const auto bins = field.within(field.points[i], radius);
        for (int64_t row = bins.top; row <= bins.bottom; row++) {
            const int64_t* start = field.starts + row * field.columns;
            for (int64_t j = start[bins.first]; j < start[bins.last + 1]; j++) {
                const double mine = field.merits[i], its = field.merits[j];
                if ((its > mine || (its == mine && j > i)) &&
                    std::norm(field.points[j] - field.points[i]) <= radius * radius)
                    alone[i] &= product(field.axes[i], field.axes[j]) <= same_axis;
            }
        }
    }
    return out;
}

VECTORS void may_be_steps(const Field& field, int64_t i, int64_t first, int64_t last, const Rules& rules, uint8_t* fit) {
    const double x = field.points[i].real(), y = field.points[i].imag(), merit = field.merits[i];
    const double u = field.axes[i].real(), v = field.axes[i].imag();
    const double least = rules.min_step * rules.min_step, most = rules.max_step * rules.max_step;
    const auto *points = reinterpret_cast<const double*>(field.points + first);
    const auto *axes = reinterpret_cast<const double*>(field.axes + first);
    const double* merits = field.merits + first;
    for (int64_t n = 0; n < last - first; n++) {
        const double dx = points[2 * n] - x, dy = points[2 * n + 1] - y, square = dx * dx + dy * dy;
        const bool near = (square > least) & (square < most) & (dy >= -rules.level_slope * std::abs(dx));
        const bool like = (merits[n] < rules.same_merit * merit) & (merit < rules.same_merit * merits[n]);
        fit[n] = near & like & (axes[2 * n] * u + axes[2 * n + 1] * v > rules.same_axis);
    }
}

Array<int64_t> collinear_triples(const py::tuple& saddles, const py::tuple& limits) {
    const Field field(saddles);
    const Rules rules(limits);
    std::vector<int64_t> out;
    {
        const py::gil_scoped_release others;
        std::vector<uint8_t> fit(field.count);
        for (int64_t i = 0; i < field.count; i++) {
            const Complex place = field.points[i];
            const auto bins = field.within(place, rules.max_step);
            const double above = (place.imag() - rules.level_slope * rules.max_step - field.top) / field.side;
            for (int64_t row = std::max(bins.top, static_cast<int64_t>(above)); row <= bins.bottom; row++) {
                const int64_t start = field.starts[row * field.columns + bins.first];
                const int64_t end = field.starts[row * field.columns + bins.last + 1];
                may_be_steps(field, i, start, end, rules, fit.data());
                for (int64_t j = start; j < end; j++) {
                    if (!fit[j - start] || !field.is_step(i, j, rules)) continue;
                    const Complex step = field.points[j] - place;
                    const double reach = rules.collinear * std::sqrt(std::norm(step));
                    const int64_t k = field.nearest(field.points[j] + step, reach, j, rules);
                    if (k >= 0 && field.is_step(j, k, rules) &&
                        (field.is_free(i, j, rules) || field.is_free(j, k, rules)))
                        out.insert(out.end(), {i, j, k});
                }
            }
        }
    }
    return array_of(out).reshape({-1, 3});
}

constexpr int RIM = 12;  // number of x-corners, in the order of corner_layouts.RIM

Array<int64_t> square_sides(const py::tuple& saddles, const Array<int64_t>& proposed, const py::tuple& limits) {
    const Field field(saddles);
    const Rules rules(limits);
    std::vector<int64_t> out;
    {
        const py::gil_scoped_release others;
        for (py::ssize_t n = 0; n < proposed.shape(0); n++) {
            const int64_t i = proposed.data()[3 * n], j = proposed.data()[3 * n + 1], k = proposed.data()[3 * n + 2];
            const Complex u = (field.points[k] - field.points[i]) / 2.0;
            const double length = std::sqrt(std::norm(u)), reach = rules.collinear * length, near = rules.square * length;
            const bool free = field.is_free(i, j, rules) && field.is_free(j, k, rules);
            for (int which = 0; which < 4; which++) {
                const int first = which % 2, end = 3 - 3 * first;
                const Complex v = which < 2 ? Complex(-u.imag(), u.real()) : Complex(u.imag(), -u.real());
                const Complex origin = field.points[i] - static_cast<double>(first) * u;
                if (field.nearest(origin + u + v, reach, j, rules) >= 0 &&
                    field.nearest(origin + 2.0 * u + v, reach, j, rules) >= 0)
                    continue;
                int64_t hits[RIM];
                std::fill_n(hits, RIM, -1);
                int found = 0;
                for (int place = 4; place < 8; place++) {  // indices in RIM: both ends of t = 1, then of t = 2
                    const double s = place % 2 * 3, t = place / 2 - 1;
                    hits[place] = field.nearest(origin + s * u + t * v, near, j, rules);
                    found += hits[place] >= 0;
                }
                if (found == 0) continue;
                hits[end] = field.nearest(origin + static_cast<double>(end) * u, near, j, rules);
                found += hits[end] >= 0;
                hits[first] = i, hits[first + 1] = j, hits[first + 2] = k;
                if (found >= (free ? rules.min_near : rules.min_near_crowded))
                    out.insert(out.end(), hits, hits + RIM);
            }
        }
    }
    return array_of(out).reshape({-1, RIM});
}

}  // namespace

inline void define_layouts(py::module_& module) {
    module.def("all_nearest", &all_nearest);
    module.def("non_maximum_suppression", &non_maximum_suppression);
    module.def("collinear_triples", &collinear_triples);
    module.def("square_sides", &square_sides);
}
