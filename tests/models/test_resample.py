import numpy as np
import pytest
import torch

from prtnet.models.resample import EVERY, HardPoints
from prtnet.models.run import Run
from prtnet.models.train import train
from tests.models.test_train import MODEL, SHORT, points, replace, saved


def _uneven(count=1000):
    """Targets whose root mean squares are 1, but for every tenth, which has 9: half of all errors."""
    size = torch.where(torch.arange(count) % 10 == 0, 9.0, 1.0)
    return size[:, None] * torch.tensor([[1.0, -1.0, 1.0]])


def test_points_are_drawn_in_proportion_to_their_errors():
    hard = HardPoints(_uneven(), 0.5, 1.0, seed=0)
    drawn = torch.cat([hard.draw(200, step) for step in range(200)])
    times = torch.bincount(drawn, minlength=1000).float()
    torch.testing.assert_close(times[::10].sum() / times.sum(), torch.tensor(0.5), rtol=0, atol=0.005)
    assert times[::10].mean() / times[1::10].mean() == pytest.approx(9, rel=0.03)
    assert times.min() > 0


def test_errors_that_fall_are_drawn_less_from_the_next_look_on():
    hard = HardPoints(_uneven(), 0.5, 1.0, seed=0)
    hard.draw(2000, 0)
    hard.note(torch.arange(0, 1000, 10), torch.zeros(100, 3))
    assert (hard.draw(2000, EVERY - 1) % 10 == 0).float().mean() == pytest.approx(0.5, abs=0.02)
    assert not (hard.draw(2000, EVERY) % 10 == 0).any()


@pytest.mark.parametrize("correction", [0.0, 1.0])
def test_corrected_the_mean_is_that_of_all_points(correction):
    """Over batches of both kinds of draws, in the long run. Without, the hard points' errors weigh them."""
    hard, values = HardPoints(_uneven(), 0.25, correction, seed=3), torch.linspace(0, 1, 1000).square()
    values[::10] *= 2
    generator, means = torch.Generator().manual_seed(1), []
    for step in range(400):
        chosen = torch.cat([torch.randint(1000, (300,), generator=generator), hard.draw(100, step)])
        means.append((values[chosen] * hard.weights(chosen)).mean())
    size = _uneven()[:, 0]
    weights = torch.ones(1000) if correction else 0.75 + 0.25 * size / size.mean()
    assert torch.stack(means).mean().item() == pytest.approx((values * weights).mean().item(), rel=0.005)


def test_a_net_without_errors_can_be_drawn_from():
    hard = HardPoints(torch.zeros(50, 3), 0.5, 1.0, 0)
    times = torch.bincount(torch.cat([hard.draw(50, step) for step in range(EVERY)]), minlength=50)
    assert (times - EVERY).abs().max() <= 1
    torch.testing.assert_close(hard.weights(torch.arange(50)), torch.ones(50), rtol=1e-5, atol=0)


def test_the_run_sees_hard_points_more_often():
    """Half of the points are dark, exactly 0, and soon learnt; the other half is what the net is wrong about."""
    given = points(2000)
    dark = given.positions[:, 1] > 0
    uneven = replace(given, transfer=np.where(dark[:, None], 0, given.transfer))
    seen = {}
    for share in (0.0, 0.5):
        run = Run(uneven, MODEL, replace(SHORT, resample=share), steps=200)
        rows = []
        for _ in range(200):
            rows.append(run._chosen())
            run.advance()
        seen[share] = 1 - dark[torch.cat(rows[100:]).numpy()].mean()
    assert seen[0.0] == pytest.approx(1 - dark.mean(), abs=0.02)
    assert seen[0.5] > seen[0.0] + 0.08


def test_a_share_that_draws_nothing_changes_nothing(tmp_path):
    plain, without = (
        train(points(), model=MODEL, options=replace(SHORT, resample=share), steps=30) for share in (0.0, 0.001)
    )
    assert saved(plain, tmp_path / "a") == saved(without, tmp_path / "b")
    other = train(points(), model=MODEL, options=replace(SHORT, resample=0.3), steps=30)
    assert saved(other, tmp_path / "c") != saved(plain, tmp_path / "a")
