"""mrcal's published solution of a Nikon D750: 186 views of a board of 10 x 10 corners, recovered from the corners."""

import ast
import base64
import io

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from procedures.geometry.adjustment import AdjustmentProblem, AdjustmentState
from procedures.geometry.bundle import first_bundle
from procedures.geometry.cameras import CameraModel
from procedures.geometry.reference import fit_formula
from procedures.geometry.shape import rigid_shape, shape_of_terms
from procedures.geometry.views import ChartView, Pose

SIDE, SIZE, SIGMA_PX = 10, (6016, 4016), 2.0


@pytest.fixture(scope="module")
def published(shared_data):
    """Their optimisation's inputs and optimum."""
    path = shared_data / "geometry" / "d750_opencv8.cameramodel"
    if not path.is_file():
        pytest.skip(f"no {path}")
    packed = ast.literal_eval(path.read_text())["optimization_inputs"]
    return np.load(io.BytesIO(base64.b85decode(packed)), allow_pickle=False)


@pytest.fixture(scope="module")
def views(published):
    """Corners that they did not classify as outliers, weighted as in their solution."""
    found = []
    for number, board in enumerate(published["observations_board"].reshape(-1, SIDE * SIDE, 3)):
        index = np.flatnonzero(board[:, 2] > 0)
        covariance = (SIGMA_PX / board[index, 2])[:, None, None] ** 2 * np.eye(2)
        found.append(ChartView(f"{number:03d}", index, board[index, :2], covariance))
    return found


def warped_board(published):
    """Nodes, and the two terms by which their board may bend: z = k_x (1 - x^2) + k_y (1 - y^2), x and y to 1."""
    i, j = np.meshgrid(np.arange(SIDE), np.arange(SIDE))
    place = np.column_stack([i.ravel(), j.ravel()]) - (SIDE - 1) / 2
    nodes = np.column_stack([1000 * float(published["calibration_object_spacing"]) * place, np.zeros(len(place))])
    terms = np.zeros((len(nodes), 3, 2))
    terms[:, 2] = 1 - (2 * place / (SIDE - 1)) ** 2
    return nodes, terms


@pytest.mark.nightly
def test_mrcals_optimum_is_recovered(published, views):
    nodes, terms = warped_board(published)
    shape = shape_of_terms(nodes, terms, np.full(2, 20.0), 0.0)
    bundle = first_bundle(nodes, views, SIZE)
    problem = AdjustmentProblem(nodes, views, shape)
    found = fit_formula("FULL_OPENCV", problem.flat_state(bundle.camera, bundle.poses), problem)
    # the residual of their camera, poses and warp: the poses are of the board's corner there
    corner, theirs = nodes[0], 1000 * published["calobject_warp"]
    camera = CameraModel("FULL_OPENCV", published["intrinsics"][0], *SIZE)
    poses = tuple(_about_centre(rt, corner) for rt in published["frames_rt_toref"])
    flat = AdjustmentProblem(nodes + terms @ theirs, views, rigid_shape(nodes))
    assert _rms(problem, found.state) == pytest.approx(_rms(flat, flat.flat_state(camera, poses)), rel=1e-4)
    # their regularisation of the distortion, and ours, pull by hundredths of the uncertainty that 2 pixels make
    sigma = np.sqrt(np.diag(found.covariance))
    assert np.abs((found.state.camera.params - camera.params) / sigma[:12]).max() < 0.1
    np.testing.assert_allclose(found.state.terms_mm, theirs, atol=0.01 * sigma[12])


def _about_centre(rt: np.ndarray, corner: np.ndarray) -> Pose:
    R = Rotation.from_rotvec(rt[:3]).as_matrix()
    return Pose(R, 1000 * rt[3:] - R @ corner)


def _rms(problem: AdjustmentProblem, state: AdjustmentState) -> float:
    return float(np.sqrt(np.mean(np.concatenate(problem.view_residuals(state)) ** 2)))
