"""Programs of implicit surfaces in torch, and autograd as another way to their gradients."""

import numpy as np
import torch

from prtnet.data.implicit.derivative import with_gradient
from prtnet.data.implicit.expression import POINT, Program, X, Y, Z, cos, floor, select, sin, sqrt
from prtnet.data.implicit.operators import around, difference, mirrored, moved, repeated, shell, turned, union
from prtnet.data.implicit.shapes import box, capsule, cone, cylinder, ellipsoid, sphere, torus
from prtnet.models import implicit

SHAPE = difference(
    union(
        mirrored(moved(ellipsoid(0.3, 0.2, 0.15), 0.4, 0.2, 0)),
        turned(box(0.3, 0.1, 0.2, round=0.05), (1, 2, 0.5), 40),
        repeated(cone(0.1, 0.02, 0.15), "z", 0.3),
        around(capsule((0.2, 0, 0), (0.6, 0.1, 0), 0.1, 0.05), "y", 5),
        torus(0.5, 0.08),
        smooth=0.2,
    ),
    shell(cylinder(0.5, 0.3), 0.02),
    moved(sphere(0.4), 0, 0.4, 0),
    smooth=0.1,
)
POINTS = np.random.default_rng(2).uniform(-1, 1, (1000, 3))


def of_torch(program):
    points = torch.tensor(POINTS, requires_grad=True)
    values = implicit.evaluate(program, points)
    values[:, 0].sum().backward()
    assert points.grad is not None
    return values.detach().numpy(), points.grad.numpy()


def test_values_and_gradients_of_a_shape():
    program = with_gradient(SHAPE(POINT))
    expected = np.stack(program.evaluate(*POINTS.T), axis=1)
    values, slopes = of_torch(program)
    np.testing.assert_allclose(values, expected, atol=1e-12)
    # on a crease the two may choose another side
    assert (np.abs(slopes - expected[:, 1:]).max(axis=1) > 1e-9).mean() < 0.003


def test_gradients_of_every_operation():
    result = select(X, Y, sin(3 * X) * cos(Y) / (2 + Z * Z), sqrt(X * X + 1.5) - abs(Y)) + floor(4 * Z) * X - (-Y) / 3
    program = with_gradient(result)
    expected = np.stack(program.evaluate(*POINTS.T), axis=1)
    values, slopes = of_torch(program)
    np.testing.assert_allclose(values, expected, atol=1e-12)
    np.testing.assert_allclose(slopes, expected[:, 1:], atol=1e-12)


def test_numbers_alone_are_results_too():
    found = implicit.evaluate(Program([X, X * 0 + 3]), torch.tensor(POINTS))
    np.testing.assert_array_equal(found[:, 1].numpy(), 3)
