// The loops of the estimation of a PSF from a chart; see __init__.py.
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
