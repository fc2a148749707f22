import numpy as np
import pytest

from procedures.numerics import kernel_prior
from procedures.numerics.kernel_prior import prior_covariance

K, S = 13, 4
x = np.arange(K) - K // 2
r2 = (x[:, None] ** 2 + x**2).ravel().astype(float)
distance = np.hypot(*(np.subtract.outer(v.ravel(), v.ravel()) for v in np.meshgrid(x, x)))


def matern(a: float, radius: float, length: float) -> np.ndarray:
    """The prior by its definition."""
    u = np.sqrt(5) * distance / length
    sigma = a * (1 + r2 / radius**2) ** -1.5
    return np.outer(sigma, sigma) * (1 + u + u**2 / 3) * np.exp(-u)


def test_the_prior_and_the_gradient_of_its_likelihood_are_those_defined(rng):
    truth = np.array([0.03, 2.5, 3.0])
    C = matern(*truth)
    errors = 0.002**2 * np.eye(K * K)
    root = np.linalg.cholesky(C + errors)
    start = kernel_prior._start(S)
    estimates = [kernel_prior._most_likely(root @ rng.standard_normal(K * K), errors, start, start) for _ in range(20)]
    # a kernel holds some ten independent values: each logarithm is known to about 0.4, the mean of twenty to 0.1;
    # the start, which regularises the search a little, lies 0.4 to 0.9 away
    np.testing.assert_allclose(np.mean(estimates, axis=0), np.log(truth), atol=0.35)
    truth = np.array([0.02, 3.0, 4.0])
    C = kernel_prior._Prior.at(np.log(truth), K).C
    # up to the uncorrelated fraction
    np.testing.assert_allclose(C, matern(*truth), atol=2 * kernel_prior.ROUGHNESS * 0.02**2)
    np.testing.assert_allclose(np.diag(C), np.diag(matern(*truth)))
    errors = 1e-6 * (np.eye(K * K) + 0.5)
    h = np.exp(-r2 / 8) / 25 + 1e-3 * rng.standard_normal(K * K)
    at = np.log([0.02, 3.0, 4.0])

    def likelihood(logarithms: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        return kernel_prior._likelihood(kernel_prior._Prior.at(logarithms, K), h, errors)

    steps = 1e-4 * np.eye(3)
    differences = [(likelihood(at + e)[0] - likelihood(at - e)[0]) / 2e-4 for e in steps]
    np.testing.assert_allclose(likelihood(at)[1], differences, rtol=1e-4)


@pytest.mark.parametrize(("noise", "share"), [(1e-5, 1.05), (1e-2, 0.4)])
def test_noise_is_suppressed_and_a_clear_kernel_is_unchanged(
    rng: np.random.Generator, noise: float, share: float
) -> None:
    h = np.exp(-r2 / 8)
    h /= h.sum()
    noisy = h + noise * rng.standard_normal(K * K)
    errors = noise**2 * np.eye(K * K)
    C = prior_covariance(noisy, errors, S)
    filtered = C @ np.linalg.solve(C + errors, noisy)
    assert np.linalg.norm(filtered - h) < share * np.linalg.norm(noisy - h)


@pytest.mark.delicate
@pytest.mark.parametrize(
    ("noise", "expected"),
    [
        (1e-4, [7.47893e-05, 6.80259e-05, 3.59817e-05, 5.03261e-08, 5.65912e-08]),
        (3e-3, [2.78347e-04, 2.41474e-04, 1.01448e-04, 4.46932e-08, 5.06040e-08]),
    ],
)
def test_the_prior_of_a_known_kernel_is_what_it_was(noise: float, expected: list[float]) -> None:
    y = np.arange(21) - 10
    h = np.exp(-(y[:, None] ** 2 + y**2) / 10).ravel()
    errors = np.random.default_rng(5).standard_normal(441)
    C = prior_covariance(h / h.sum() + noise * errors, noise**2 * np.eye(441), S)
    np.testing.assert_allclose([C[220, 220], C[220, 221], C[220, 223], C[0, 0], C[0, 21]], expected, rtol=1e-4)
