"""The search for a size, on curves that are made up."""

import numpy as np
import pytest

from prtnet import PrtnetError, size
from prtnet.size import Candidate, Trial

WIDTHS, DEPTHS, FAMILIES = (8, 16, 24, 32, 48, 64), (1, 2, 4), ("plain", "grids")


def space():
    """36 nets and two without a hidden layer."""
    made = []
    for family in FAMILIES:
        extra = 100 * (family == "grids")
        made.append(Candidate(f"linear {family}", 0, 0, family, 1000 + extra, 4000 + 50 * extra))
        for depth in DEPTHS:
            for width in WIDTHS:
                macs = 80 * width + (depth - 1) * width**2 + extra
                made.append(Candidate(f"{depth}x{width} {family}", width, depth, family, macs, 4 * macs + 50 * extra))
    return made


class World:
    """PSNR = final - b (share^-c - 1) + noise, where the final one grows with cost and levels off."""

    def __init__(self, seed, noise=0.15):
        rng = np.random.default_rng(seed)
        self.candidates = space()
        low, rise, level = rng.uniform(20, 30), rng.uniform(0.8, 2.5), rng.uniform(40, 50)
        power, steep, grids = rng.uniform(0.1, 0.5), rng.uniform(1, 4), rng.uniform(-1, 5)
        self.final, self.gain = {}, {}
        for each in self.candidates:
            raw = (
                low + rise * np.log2(each.macs / 500) + grids * (each.family == "grids") + 0.8 * np.log2(1 + each.depth)
            )
            self.final[each.name] = level - 3 * np.logaddexp(0, (level - raw) / 3) + rng.normal(0, noise)
            self.gain[each.name] = steep * (1 + 0.05 * np.log2(each.macs / 500)), power
        self.noise = {(each.name, share): rng.normal(0, noise) for each in self.candidates for share in size.SHARES}
        self.spent, self.asked = 0.0, []

    def trial(self, candidate, share):
        self.spent += share
        self.asked.append((candidate.name, share))
        steep, power = self.gain[candidate.name]
        psnr = self.final[candidate.name] - steep * (share**-power - 1)
        psnr += self.noise[candidate.name, share] if share < 1 else 0
        return Trial(psnr, psnr - 2, 10.0 * share)

    def cheapest(self, target, **budgets):
        kept = size.within(self.candidates, **({"max_macs": None, "max_bytes": None} | budgets))
        return next((each for each in kept if self.final[each.name] >= target), None)

    def target(self, share):
        low, high = min(self.final.values()), max(self.final.values())
        return low + share * (high - low)


def search(world, **options):
    return size.search(world.candidates, world.trial, **options)


def world_and_target(seed):
    world = World(seed)
    return world, world.target(np.random.default_rng(seed).uniform(0.05, 0.98))


def test_the_cheapest_is_found_for_a_fraction_of_the_sweep():
    right, spent = 0, []
    for seed in range(60):
        world, target = world_and_target(seed)
        right += search(world, target=target).choice == world.cheapest(target)
        spent.append(world.spent / len(world.candidates))
    assert right >= 57
    assert np.mean(spent) < 0.25
    assert max(spent) < 0.55


@pytest.mark.parametrize("seed", range(0, 20, 4))
def test_what_is_chosen_was_trained_in_full_and_meets_the_target(seed):
    world, target = world_and_target(seed)
    found = search(world, target=target)
    (last,) = (each for each in found.tried if each.candidate == found.choice and each.share == 1)
    assert last.psnr == world.final[found.choice.name] >= target
    assert found.expected[found.choice.name] == (last.psnr, 0)
    assert len(set(world.asked)) == len(world.asked), "nothing is trained twice"
    assert found.cpu_seconds == pytest.approx(10 * world.spent)
    assert found.sweep_seconds == pytest.approx(10 * len(world.candidates))


def test_the_same_trials_give_the_same_search():
    runs = []
    for _ in range(2):
        world, target = world_and_target(3)
        order = np.random.default_rng(len(runs)).permutation(len(world.candidates))
        runs.append((size.search([world.candidates[i] for i in order], world.trial, target=target), world.asked))
    assert runs[0] == runs[1]


@pytest.mark.parametrize("seed", range(6))
def test_budgets_alone_give_about_the_best_within_them(seed):
    world = World(seed)
    found = search(world, max_macs=5000, max_bytes=24_000)
    allowed = [each for each in world.candidates if each.macs <= 5000 and each.bytes <= 24_000]
    assert 5 < len(allowed) < 30
    assert list(found.candidates) == sorted(allowed, key=lambda each: each.macs)
    assert {name for name, _ in world.asked} == {each.name for each in allowed}
    assert found.choice in allowed
    # noise may prefer another of the best
    assert world.final[found.choice.name] >= max(world.final[each.name] for each in allowed) - 0.5
    assert world.spent < 0.5 * len(allowed)
    assert found.best.candidate == found.choice


def test_a_target_within_a_budget():
    world = World(1)
    target = world.final["2x24 plain"]
    needed = world.cheapest(target)
    assert search(world, target=target, max_macs=needed.macs).choice == needed
    found = search(world, target=target, max_macs=needed.macs - 1)
    assert found.choice is None
    assert all(each.candidate.macs < needed.macs for each in found.tried)


def test_bytes_can_be_the_cost():
    world = World(1)
    # a grid is worth its bytes here only where multiply-adds count
    target = world.final["2x24 grids"]
    by_macs, by_bytes = (search(World(1), target=target, cost=cost) for cost in ("macs", "bytes"))
    meets = [each for each in world.candidates if world.final[each.name] >= target]
    assert by_bytes.choice == min(meets, key=lambda each: each.bytes)
    assert by_macs.choice == min(meets, key=lambda each: each.macs)
    assert by_bytes.choice != by_macs.choice


def test_the_worst_view_can_count():
    world = World(4)
    mean, worst = search(world, target=world.target(0.5)), search(World(4), target=world.target(0.5) - 2, view="worst")
    assert mean.choice == worst.choice
    assert worst.best.psnr == worst.best.trial.psnr_worst


def test_a_net_without_a_hidden_layer_is_enough_where_all_meet_the_target():
    world = World(5)
    found = search(world, target=min(world.final.values()) - 1)
    assert found.choice == found.candidates[0]
    assert [name for name, share in world.asked if share == 1] == [found.choice.name]
    assert "nothing is cheaper" in found.reason


@pytest.mark.parametrize(
    ("change", "limit"),
    [({}, "capacity"), ({"flat": True}, "flat"), ({"short": True}, "training"), ({"floor": 1.0}, "noise")],
)
def test_what_nothing_meets_is_said_with_the_best_and_what_limits_it(change, limit):
    world = World(0)
    if "flat" in change or "floor" in change:
        world.final = dict.fromkeys(world.final, 40.0)
    if "short" not in change:
        world.gain = dict.fromkeys(world.gain, (0.3, 0.3))
    else:
        world.gain = dict.fromkeys(world.gain, (4.0, 0.4))
    best = max(world.final.values())
    found = search(world, target=best + 0.1, floor=best + change["floor"] if "floor" in change else best + 20)
    assert found.choice is None
    assert limit in found.limits
    assert ("flat" in found.limits) == (limit == "flat")
    assert found.best.psnr == best
    assert f"{best:.2f}" in found.reason
    # the last trial may begin just before half
    assert world.spent < 0.5 * len(world.candidates) + 1


def test_nothing_is_trained_for_a_target_above_the_noise_floor():
    world = World(0)
    found = search(world, target=50.0, floor=48.0)
    assert (found.choice, found.best, world.asked) == (None, None, [])
    assert "render.traced_directions" in found.limits["noise"]
    assert "48.0" in found.reason


def test_one_candidate_is_trained_once():
    world = World(0)
    world.candidates = world.candidates[:1]
    assert search(world, max_macs=1e6).choice == world.candidates[0]
    assert world.asked == [("linear plain", 1.0)]


def test_trials_are_told_with_what_is_to_come():
    world, target = world_and_target(6)
    told = []
    found = search(world, target=target, on_trial=lambda tried, to_come: told.append((tried, to_come)))
    assert [tried for tried, _ in told] == list(found.tried)
    assert all(to_come > 0 for _, to_come in told[:-1])
    assert told[-1][1] == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "neither a target nor a budget"),
        ({"max_macs": 500}, r"size.max_macs: found 500, but the cheapest candidate, 1x8 plain, takes 640"),
        ({"max_bytes": 99, "target": 30}, r"size.max_bytes: found 99, but .* takes 2560 bytes"),
        ({"max_macs": 800, "max_bytes": 2560.0}, None),
    ],
)
def test_impossible_budgets_are_refused_before_any_trial(options, message):
    world = World(0)
    if message is None:
        assert search(world, **options).choice.name == "1x8 plain"
        return
    with pytest.raises(PrtnetError, match=message):
        search(world, **options)
    assert not world.asked


def test_an_empty_space_is_refused():
    with pytest.raises(PrtnetError, match="found no candidate"):
        size.search([], World(0).trial, target=30.0)


def test_the_predictor_learns_the_gain_from_those_with_two_shares():
    """The gain of a net with one short trial is about that of the other, which has all three."""
    candidates = [Candidate(family, 16, 2, family, 1600, 6400) for family in ("plain", "grids")]
    for gain in (0.5, 3.0):
        tried = [(0, share, 40 + gain * power) for share, power in zip(size.SHARES, (-2, -1, 0), strict=True)]
        alone, spread_alone = size.expect(candidates, [(1, 1 / 9, 35.0)])
        both, spread_both = size.expect(candidates, [*tried, (1, 1 / 9, 35.0)])
        assert both[1] == pytest.approx(35 + 2 * gain, abs=1.5)
        assert abs(both[1] - 35 - 2 * gain) < abs(alone[1] - 35 - 2 * gain)
        assert spread_both[1] < spread_alone[1]
        assert both[0] == pytest.approx(40, abs=0.01)
