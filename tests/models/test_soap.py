import torch

from prtnet.models.soap import Soap


def _ill_conditioned(seed=0):
    """A quadratic bowl 1/2 |A (W - W*) B|^2 whose axes are turned and stretched by up to 100."""
    generator = torch.Generator().manual_seed(seed)
    turns = [torch.linalg.qr(torch.randn(6, 6, generator=generator)).Q for _ in range(4)]
    stretch = torch.logspace(-1, 1, 6)
    left, right = turns[0] * stretch @ turns[1], turns[2] * stretch @ turns[3]
    goal = torch.randn(6, 6, generator=generator)
    return lambda matrix: 0.5 * (left @ (matrix - goal) @ right).square().sum()


def _descend(make, steps=400):
    bowl, matrix = _ill_conditioned(), torch.nn.Parameter(torch.zeros(6, 6))
    optimiser = make([matrix])
    for step in range(steps):
        optimiser.param_groups[0]["lr"] = 0.1 * (1 - step / steps)
        bowl(matrix).backward()
        optimiser.step()
        optimiser.zero_grad()
    return bowl(matrix).item(), optimiser


def test_it_goes_down_an_ill_conditioned_bowl_where_adam_does_not():
    soap, _ = _descend(lambda matrices: Soap(matrices, lr=0.1, every=1))
    adam, _ = _descend(lambda matrices: torch.optim.Adam(matrices, lr=0.1, betas=(0.95, 0.95)))
    assert soap < 0.01 * adam


def test_bases_stay_orthonormal():
    _, optimiser = _descend(lambda matrices: Soap(matrices, lr=0.1))
    (state,) = optimiser.state.values()
    for side in ("left", "right"):
        basis = state[f"{side}_basis"]
        torch.testing.assert_close(basis.T @ basis, torch.eye(6), rtol=0, atol=1e-5)


def test_with_one_direction_it_is_adam():
    """A 1 x 1 matrix has the bases (1) and (1), and nothing to turn."""
    values = []
    for make in (lambda p: Soap(p, lr=0.1, decay=0.0), lambda p: torch.optim.Adam(p, lr=0.1, betas=(0.95, 0.95))):
        parameter = torch.nn.Parameter(torch.tensor([[3.0]]))
        optimiser = make([parameter])
        for _ in range(50):
            (parameter - 1).square().sum().backward()
            optimiser.step()
            optimiser.zero_grad()
        values.append(parameter.detach())
    torch.testing.assert_close(values[0], values[1], rtol=0, atol=1e-5)


def test_decay_shrinks_what_no_gradient_holds():
    parameter = torch.nn.Parameter(torch.tensor([[2.0]]))
    optimiser = Soap([parameter], lr=0.1, decay=0.5)
    for _ in range(3):
        parameter.grad = torch.zeros_like(parameter)
        optimiser.step()
    torch.testing.assert_close(parameter.detach(), torch.tensor([[2.0 * 0.95**3]]))
