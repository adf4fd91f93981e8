"""Made-up data-driven transfer: a random orthonormal basis, a random matrix for each keyframe."""

import numpy as np

from prtnet.data_driven import DataDriven, Measurement


def measurement(rng, points: int, coefficients: int = 0) -> Measurement:
    positions, normals, geometric = (rng.uniform(-1, 1, (points, 2, 3)).astype(np.float32) for _ in range(3))
    transfer = rng.normal(size=(points, coefficients, 3)).astype(np.float32)
    return Measurement(positions, normals, geometric, rng.random((points, 2, 3), np.float32), transfer)


def random_spec(
    seed=0, *, elements=6, points=23, size=24, banks=1, keyframes=1, gamma=1.0, coefficients=0, texels=None, **more
) -> DataDriven:
    """Three quarters of the atlas in use, or `texels`, flat."""
    rng = np.random.default_rng(seed)
    used = np.flatnonzero(rng.random(size * size) < 0.75) if texels is None else texels
    rows = [np.linalg.qr(rng.normal(size=(len(used), elements)))[0].T for _ in range(banks)]
    return DataDriven(
        np.stack(rows).astype(np.float32),
        rng.normal(size=(keyframes, banks, elements, points)).astype(np.float32),
        tuple(measurement(rng, points, coefficients) for _ in range(keyframes)),
        np.asarray(used, np.int32),
        size,
        "made up",
        gamma,
        **more,
    )


def direct(spec: DataDriven, seed=1) -> np.ndarray:
    return np.random.default_rng(seed).random((spec.matrices.shape[3], 3)).astype(np.float32)
