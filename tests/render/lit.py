"""Points to be lit and their light, without SH, for the tests of that reference."""

import numpy as np

from prtnet.data.light_sampler import ImageSampler
from prtnet.render import exact
from prtnet.render.exact import Points

WHITE = ImageSampler(np.ones((16, 32, 3), np.float32))


def points(tracer, positions, normals, *, diffuse=1.0, specular=0.0, exponent=1.0, mirrored=None, sides=None):
    normals = np.asarray(normals, np.float64)
    count = len(normals)
    return Points(
        tracer.origins(np.asarray(positions, np.float64), normals if sides is None else sides),
        normals,
        normals if mirrored is None else np.asarray(mirrored, np.float64),
        np.ones((count, 3)) * diffuse,
        np.ones((count, 3)) * specular,
        np.full(count, float(exponent)),
    )


def estimate(world, given, samples=1 << 14, seed=0, **more):
    return exact.radiance(world, given, samples=samples, rng=np.random.default_rng(seed), **more)
