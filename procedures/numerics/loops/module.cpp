// The loops of the PSF of a chart, compiled ahead of time: its command starts without a compiler.
#include "edges.h"
#include "layouts.h"
#include "matrices.h"
#include "saddles.h"
#include "splines.h"

PYBIND11_MODULE(_native, module) {
    define_splines(module);
    define_matrices(module);
    define_edges(module);
    define_saddles(module);
    define_layouts(module);
}
