import numpy as np
import pytest

from prtnet import PrtnetError, netspec
from prtnet.models import patience
from prtnet.models.train import train
from tests.models.test_train import MODEL, SHORT, points, replace, saved

# a constant rate on noise: what is kept back gets no better from early on
STUCK = replace(SHORT, schedule="constant", patience=3)


def noisy(count=400):
    given = points(count)
    noise = np.random.default_rng(0).normal(size=given.transfer.shape)
    return replace(given, transfer=noise.astype(np.float32))


def test_a_run_that_gets_no_better_stops_and_hands_over_its_best(tmp_path):
    result = train(noisy(), model=MODEL, options=STUCK, steps=2000)
    assert result.steps == len(result.history) < 1200
    assert result.steps % 100 == 0
    # the best look was `patience` looks before the last
    best = train(noisy(), model=MODEL, options=replace(STUCK, patience=9), steps=2000)
    assert saved(best, tmp_path / "a") == saved(result, tmp_path / "b")
    _, back = patience.split(noisy())
    to_the_end = train(patience.split(noisy())[0], model=MODEL, options=replace(STUCK, patience=0), steps=result.steps)
    errors = [
        np.mean((netspec.evaluate_unit(each.net, back.positions, back.normals) - back.transfer) ** 2)
        for each in (result, to_the_end)
    ]
    assert errors[0] < errors[1]


def test_a_run_that_gets_better_goes_on_to_its_end(tmp_path):
    given = points(2000)
    result = train(given, model=MODEL, options=replace(SHORT, patience=2), steps=200)
    assert result.steps == 200
    # with a rate that falls to 0 the last weights are the best
    plain = train(patience.split(given)[0], model=MODEL, options=SHORT, steps=200)
    assert saved(result, tmp_path / "a") == saved(plain, tmp_path / "b")


def test_a_few_points_in_twenty_are_kept_back():
    for count, expected in ((400, 20), (200_000, 4081)):
        given = points(count)
        learnt, back = patience.split(given)
        assert len(back.transfer) == expected
        both = np.concatenate([learnt.positions, back.positions])
        np.testing.assert_array_equal(np.sort(both, axis=0), np.sort(given.positions, axis=0))
    with pytest.raises(PrtnetError, match=r"train\.patience: found 19 training points, expected at least 20"):
        patience.split(points(19))


def test_interrupted_and_resumed_it_stops_where_it_would_have(tmp_path, monkeypatch):
    monkeypatch.setattr("prtnet.models.train._LOG_SECONDS", 0.0)
    options = replace(STUCK, checkpoint_seconds=1e-9)

    def interrupt(seen):
        if seen["step"] == whole.steps - 130:
            raise KeyboardInterrupt

    whole = train(noisy(), model=MODEL, options=options, steps=2000)
    path = tmp_path / "checkpoint"
    with pytest.raises(KeyboardInterrupt):
        train(noisy(), model=MODEL, options=options, steps=2000, checkpoint_path=path, on_log=interrupt)
    resumed = train(noisy(), model=MODEL, options=options, steps=2000, checkpoint_path=path)
    assert resumed.steps == whole.steps
    np.testing.assert_array_equal(resumed.history, whole.history)
    assert saved(resumed, tmp_path / "a") == saved(whole, tmp_path / "b")


def test_a_run_that_was_stopped_stays_so(tmp_path):
    """Its last checkpoint says that it is over: no step is added."""
    first, again = (
        train(noisy(), model=MODEL, options=STUCK, steps=2000, checkpoint_path=tmp_path / "checkpoint")
        for _ in range(2)
    )
    assert first.steps == again.steps
    assert first.cpu_seconds == again.cpu_seconds
    assert saved(first, tmp_path / "a") == saved(again, tmp_path / "b")
