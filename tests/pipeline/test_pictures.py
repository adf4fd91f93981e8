"""Pictures of a run: written on request, never touching a score."""

import numpy as np
import pytest
from PIL import Image

from prtnet import PrtnetError, store
from prtnet.pipeline import run
from tests.pipeline.test_pipeline import artifacts, config

SMALL = {"methods": ["texture"]}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = tmp_path_factory.mktemp("pictures")
    run(config(out, **SMALL))
    return out


def shown(out, name="traced"):
    with Image.open(out / "pictures" / f"{name}.png") as picture:
        return np.asarray(picture)


def test_display_options_change_pictures_and_no_score(finished):
    assert not (finished / "pictures").exists()
    scores, rows = artifacts(finished, "score"), (finished / "score.json").read_bytes()
    run(config(finished, **SMALL, render__pictures=True))
    assert {path.name for path in (finished / "pictures").glob("*.png")} == {"traced.png", "texture.png"}
    plain = shown(finished)
    # as it is scored, in 8 bits
    kept = store.load_arrays(next((finished / "cache" / "score").glob("*.safetensors")))
    assert np.abs(plain - 255 * kept["traced"][0].astype(float)).max() <= 1
    for changes in ({"tone": "exposure"}, {"highlights": 0.2}, {"bloom": 1.0, "highlights": 0.2}):
        before = shown(finished)
        run(config(finished, **SMALL, **{f"render__{key}": value for key, value in changes.items()}))
        assert np.any(shown(finished) != before), changes
    assert artifacts(finished, "score") == scores
    assert (finished / "score.json").read_bytes() == rows


def test_pictures_are_written_once(finished):
    def run_again():
        run(config(finished, **SMALL, render__tone="reinhard"))
        return (finished / "pictures" / "texture.png").stat().st_mtime_ns

    assert run_again() == run_again()


def test_a_light_with_bands_of_its_own_is_shown(finished):
    glossy = {"material__specular": [0.5, 0.5, 0.5], "material__light_bands": 2}
    run(config(finished / "bands", cache=str(finished / "cache"), **SMALL, **glossy, render__pictures=True))
    assert shown(finished / "bands").any()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"render__tone": "filmic"}, r"render\.tone: found 'filmic'"),
        ({"render__bloom": -0.1}, r"render\.bloom: found -0\.1"),
        ({"render__highlights": 0.5, "light__name": "directional"}, r"render\.highlights: found 0\.5 with light"),
    ],
)
def test_bad_options_are_refused_before_any_work(tmp_path, changes, message):
    with pytest.raises(PrtnetError, match=message):
        run(config(tmp_path, **SMALL, **changes))
    assert not list(tmp_path.iterdir())
