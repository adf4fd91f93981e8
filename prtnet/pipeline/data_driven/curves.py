"""How the error of data-driven transfer depends on what it is learned from: all that one database can tell, in memory.

Errors are relative. Each colour of a configuration is divided by the norm of its direct vector, as in learning, so that
no bright light outweighs the others; an error is the root of the sum of its squares over that of the lightmaps' own.
"""

import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float, Float64

from prtnet import PrtnetError, store
from prtnet.data.lighting.lamp import Lighting
from prtnet.models.data_driven import Learned, Pairs, basis_of, learn, normalised, ridge_of
from prtnet.pipeline.data_driven import colours
from prtnet.pipeline.data_driven import errors as measured
from prtnet.pipeline.data_driven.database import Database
from prtnet.pipeline.data_driven.learn import Operator
from prtnet.pipeline.job import Job

Array = np.ndarray
Line = dict[str, Any]

VERSION = 3  # raised when lines change for the same database
ELEMENTS = (1, 2, 4, 8, 16, 32, 64)
POINTS = (16, 32, 64, 128, 256, 512, 1024)
RIDGES = (0.0, 1e-4, 1e-3, 0.01, 0.03, 0.1, 0.3, 1.0)
SHARES = (1, 4, 16, 64)  # of the rays: one in so many
SPACES = (("shared", 1.0), ("separate", 1.0), ("shared", 2.2), ("separate", 2.2))


def write(job: Job, made: Operator) -> None:
    """Write curves.json into the run's folder, with the operator's own settings where they do not vary."""
    options = job.config.data_driven
    settings = {"elements": options.elements, "ridge": options.ridge}
    inputs = settings | {
        "scenario": list(options.scenario),
        "version": VERSION,
        "training": made.training.key,
        "unseen": made.unseen.key,
    }
    training, unseen = (Pairs(each.lightmaps, each.direct, _frames(each)) for each in (made.training, made.unseen))

    def make() -> tuple[dict[str, Array], dict[str, Any]]:
        lightings, rng = made.unseen.lightings, job.rng("curves")
        words = {"lightings": lightings, "scenario": options.scenario, "rng": rng} | settings
        return {}, measure(training, unseen, noise=made.training.noise, **words)

    found = job.store.make("curves", inputs, make).facts
    store.write_text(job.out / "curves.json", json.dumps(found, indent=1) + "\n")


def _frames(database: Database) -> Array | None:
    """The keyframes of configurations, where there are several."""
    return database.keyframe if database.keyframe.any() else None


def measure(
    training: Pairs,
    unseen: Pairs,
    *,
    noise: Float[Array, " t"],
    lightings: Sequence[Lighting] = (),
    scenario: Sequence[str] = (),
    elements: int = 16,
    ridge: float = 0.01,
    rng: np.random.Generator,
) -> dict[str, list[Line]]:
    """Lines by what varies, each with the errors under the lights learned from (training), under others (unseen) and
    of the plain projection of these others on the basis (projection); what does not vary is `elements`, `ridge`,
    shared channels and a linear space. `noise`: standard error of a texel; `lightings`: those of `unseen`.

    Unseen lights are those of the kinds in `scenario`, where there are some, but for the lines of `lights`, which has
    all by kind. A setting for which the database is too small has no line.
    """
    few, every = compressed(training, unseen)
    kinds = np.array([kind_of(each) for each in lightings])
    alike = np.flatnonzero(np.isin(kinds, list(scenario)))
    alike = alike if len(alike) else np.arange(len(unseen.direct))
    tested, asked = chosen(every, alike), chosen(unseen, alike)
    plain = {"elements": elements, "ridge": ridge}
    sizes = _halves(_each(few))
    found = {
        "elements": by_elements(few, tested, ridge),
        "points": by_points(few, tested, **plain),
        "ridge": by_ridge(few, tested, elements),
        "configurations": [_line({"configurations": c}, first(few, c), tested, **plain) for c in sizes],
        "noise": by_noise(training, asked, noise, rng=rng, **plain),
        "spaces": by_space(training, asked, **plain),
        "lights": by_light(few, every, kinds, **plain),
    }
    if few.keyframe is not None:
        words = ("each", "one")
        found["matrices"] = [_line({"matrices": word}, few, tested, matrices=word, **plain) for word in words]
    return {name: [line for line in lines if line] for name, lines in found.items()}


def errors(
    learned: Learned,
    pairs: Pairs,
    *,
    gamma: float = 1.0,
    elements: int | None = None,
    sizes: Float64[Array, "c 3"] | None = None,
) -> tuple[float, float]:
    """(of the operator, of the projection on its basis) with the first `elements` of it; `sizes`: what configurations
    are divided by, where it is not the norm of these direct vectors."""
    first = slice(elements)
    found = measured.errors(
        learned.basis[:, first],
        learned.matrices[:, :, first],
        pairs.lightmaps,
        pairs.direct,
        gamma=gamma,
        keyframe=pairs.keyframe if len(learned.matrices) > 1 else None,
        sizes=sizes,
    )
    return found.rmse / max(found.level, 1e-30), found.projection / max(found.level, 1e-30)


def compressed(training: Pairs, unseen: Pairs) -> tuple[Pairs, Pairs]:
    """The same pairs with lightmaps in coordinates of an orthonormal basis of all of them, fewer than texels are.

    No inner product changes by it, so neither do bases, operators and errors in a linear space.
    """
    rows = [np.moveaxis(each.lightmaps, 2, 1).reshape(-1, each.lightmaps.shape[1]) for each in (training, unseen)]
    stacked = np.concatenate(rows).astype(np.float64)
    if len(stacked) >= stacked.shape[1]:
        return training, unseen
    # Q R = stacked^T, and so R^T are the coordinates of its rows
    coordinates = np.asarray(np.linalg.qr(stacked.T, mode="r")).T.astype(np.float32)
    parts = np.split(coordinates, [len(rows[0])])
    maps = [np.moveaxis(each.reshape(-1, 3, each.shape[1]), 1, 2) for each in parts]
    return replace(training, lightmaps=maps[0]), replace(unseen, lightmaps=maps[1])


def by_elements(training: Pairs, unseen: Pairs, ridge: float) -> list[Line]:
    """Of 1 to 64 elements: the first of a larger basis are those of a smaller one."""
    for most in reversed(ELEMENTS):
        learned = _learned(training, elements=most, ridge=ridge)
        if learned:
            return [{"elements": n} | _errors(learned, training, unseen, elements=n) for n in _up_to(ELEMENTS, most)]
    return []


def by_ridge(training: Pairs, unseen: Pairs, elements: int) -> list[Line]:
    """Of several lambdas for one basis."""
    frames = np.zeros(len(training.direct), int) if training.keyframe is None else training.keyframe
    bank = normalised(training.lightmaps, training.direct, frames)
    try:
        basis, c = basis_of(bank.lightmaps, elements)
    except PrtnetError:
        return []
    own = [bank.keyframe == each for each in range(int(frames.max()) + 1)]
    lines = []
    for ridge in RIDGES:
        matrices = np.stack([ridge_of(c[:, each], bank.direct[:, each], ridge) for each in own])
        learned = Learned(basis[None].astype(np.float32), matrices[:, None].astype(np.float32), 0, 0)
        lines.append({"ridge": ridge} | _errors(learned, training, unseen))
    return lines


def by_points(training: Pairs, unseen: Pairs, **settings: Any) -> list[Line]:
    """Of the first measurement points: sample elimination leaves them in an order of which any beginning is spread
    well. Errors are divided by what all points measure, so that they compare."""
    lines = []
    for count in _up_to(POINTS, training.direct.shape[1]):
        learned = _learned(_first_points(training, count), **settings)
        if learned:
            own = errors(
                learned,
                _first_points(training, count),
                sizes=measured.learned_from(training.lightmaps, training.direct),
            )[0]
            other, projection = errors(learned, _first_points(unseen, count), sizes=measured.norms(unseen.direct))
            lines.append({"points": count, "training": own, "unseen": other, "projection": projection})
    return lines


def by_noise(
    training: Pairs, unseen: Pairs, noise: Float[Array, " t"], *, rng: np.random.Generator, **settings: Any
) -> list[Line]:
    """Of lightmaps as noisy as those of fewer rays are, each colour by its brightness; asked is how near those of all
    rays are. `noise`, a line's own: the noise of its lightmaps, over their RMS."""
    levels = np.sqrt(np.mean(np.square(training.lightmaps, dtype=np.float64), axis=1))
    level = max(float(np.sqrt(np.mean(levels**2))), 1e-30)
    own = float(np.sqrt(np.mean(np.square(noise, dtype=np.float64)))) / level
    spread = np.einsum("ch,t->cth", levels / level, noise).astype(np.float32)
    lines = []
    for share in SHARES:
        more = rng.standard_normal(training.lightmaps.shape, np.float32) * spread * np.float32(np.sqrt(share - 1))
        learned = _learned(replace(training, lightmaps=training.lightmaps + more), **settings)
        if learned:
            line = {"rays": 1 / share, "noise": float(own * np.sqrt(share))}
            lines.append(line | _errors(learned, training, unseen))
    return lines


def by_space(training: Pairs, unseen: Pairs, **settings: Any) -> list[Line]:
    """Of one basis for all colours or one for each, in a linear space or that of displays; `coloured`: under the unseen
    lights in colours. With all colours in one vector (joint) the operator learns what light is like, not the scene."""
    coloured = colours.tinted(unseen)
    lines = []
    for channels, gamma in SPACES:
        learned = _learned(training, channels=channels, gamma=gamma, **settings)
        if learned:
            line = {"channels": channels, "gamma": gamma} | _errors(learned, training, unseen, gamma=gamma)
            lines.append(line | {"coloured": errors(learned, coloured, gamma=gamma)[0]})
    return [*lines, colours.joint(training, unseen, coloured, **settings)]


def by_light(training: Pairs, unseen: Pairs, kinds: Array, **settings: Any) -> list[Line]:
    """Of each kind of the unseen lights, where kinds are known."""
    learned = _learned(training, **settings) if len(kinds) else None
    if learned is None:
        return []
    return [{"kind": str(kind)} | _errors(learned, None, chosen(unseen, kinds == kind)) for kind in np.unique(kinds)]


def kind_of(lighting: Lighting) -> str:
    """Of its lamps, where all are alike; environment, where it has none; else mixed."""
    kinds = {lamp.kind for lamp in lighting.lamps}
    kinds |= {"environment"} if lighting.environment is not None else set()
    return kinds.pop() if len(kinds) == 1 else "mixed"


def chosen(pairs: Pairs, rows: Array) -> Pairs:
    """Some of the configurations."""
    keyframe = None if pairs.keyframe is None else pairs.keyframe[rows]
    return Pairs(pairs.lightmaps[rows], pairs.direct[rows], keyframe)


def first(pairs: Pairs, count: int) -> Pairs:
    """The first configurations, of each keyframe so many."""
    keyframe = np.zeros(len(pairs.direct), int) if pairs.keyframe is None else pairs.keyframe
    rows = [np.flatnonzero(keyframe == each)[:count] for each in np.unique(keyframe)]
    return chosen(pairs, np.concatenate(rows))


def _first_points(pairs: Pairs, count: int) -> Pairs:
    return replace(pairs, direct=pairs.direct[:, :count])


def _each(pairs: Pairs) -> int:
    """Configurations of a keyframe."""
    return len(pairs.direct) if pairs.keyframe is None else int(np.bincount(pairs.keyframe).min())


def _halves(count: int) -> list[int]:
    """Half of it, half of that and so on down to 8, and itself, rising."""
    sizes = [count]
    while sizes[-1] >= 16:
        sizes.append(sizes[-1] // 2)
    return sizes[::-1]


def _up_to(values: Sequence[int], most: int) -> list[int]:
    return sorted({*(value for value in values if value < most), most})


def _learned(pairs: Pairs, **settings: Any) -> Learned | None:
    """None where there are too few configurations for so many elements."""
    try:
        return learn(pairs, **settings)
    except PrtnetError:
        return None


def _errors(learned: Learned, training: Pairs | None, unseen: Pairs, **settings: Any) -> Line:
    operator, projection = errors(learned, unseen, **settings)
    found = {"unseen": operator, "projection": projection}
    if training is None:
        return found
    own = measured.learned_from(training.lightmaps, training.direct)
    return {"training": errors(learned, training, sizes=own, **settings)[0]} | found


def _line(words: Line, training: Pairs, unseen: Pairs, **settings: Any) -> Line:
    """Errors of what is learned with these settings; empty where there are too few configurations for it."""
    learned = _learned(training, **settings)
    return words | _errors(learned, training, unseen) if learned else {}
