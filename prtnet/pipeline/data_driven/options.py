"""What can be wrong with the options of data-driven transfer, found before any work."""

from prtnet import PrtnetError
from prtnet.config import Config, DataDrivenOptions
from prtnet.data.lighting import scenario
from prtnet.pipeline import scenes

NAME = scenes.DATA_DRIVEN
BOUNCES, SUBSURFACE = "bounces", "subsurface"
RENDERERS = (BOUNCES, SUBSURFACE)
CHOICES = {
    "renderer": RENDERERS,
    "channels": ("shared", "separate"),
    "matrices": ("each", "one"),
    "place": ("surface", "hull"),
}
LEAST = {
    "configurations": 1,
    "unseen": 1,
    "points": 1,
    "supersampling": 1,
    "elements": 1,
    "ridge": 0,
    "size": 16,
    "directions": 2,
    "bounces": 1,
    "tested_views": 1,
    "tested_lights": 1,
    "samples": 1,
}


def kinds(options: DataDrivenOptions, purpose: str) -> list[str]:
    """Of the lights of a database: to learn from, or unseen."""
    return list(options.lit_by or options.scenario) if purpose == "unseen" else list(options.scenario)


def environments(options: DataDrivenOptions) -> bool:
    """Whether there is light from far away."""
    return "environment" in {*options.scenario, *options.lit_by}


def alone(config: Config) -> bool:
    """Whether the run has no other method: then nothing is made for one."""
    return list(config.methods) == [NAME]


def check(config: Config) -> None:
    """Raises PrtnetError where the method is asked for and cannot be had."""
    options = config.data_driven
    if NAME not in config.methods:
        return
    for key, allowed in CHOICES.items():
        found = getattr(options, key)
        if found not in allowed:
            raise PrtnetError(f"data_driven.{key}: found {found!r}, expected one of {', '.join(allowed)}")
    for key, least in LEAST.items():
        found = getattr(options, key)
        if found < least:
            raise PrtnetError(f"data_driven.{key}: found {found}, expected at least {least}")
    if not options.gamma > 0:
        raise PrtnetError(f"data_driven.gamma: found {options.gamma}, expected a number above 0")
    total = options.configurations * max(1, len(options.keyframes)) * (3 if options.channels == "shared" else 1)
    if total < options.elements:
        raise PrtnetError(
            f"data_driven.configurations: found {options.configurations}, expected at least one for each of the"
            f" {options.elements} elements; raise it or lower data_driven.elements"
        )
    for purpose in ("training", "unseen"):
        scenario.check(kinds(options, purpose), options.colours)
    if scenes.is_implicit(config.scene):
        raise PrtnetError("methods: found data_driven on an implicit surface, which has no atlas for lightmaps")
    if config.atlas.sets != "one":
        raise PrtnetError(f"atlas.sets: found {config.atlas.sets}, expected one: a lightmap is of the whole scene")
    if not alone(config):
        _check_beside(config)
    if options.renderer == SUBSURFACE:
        from prtnet.data.lightmap import mitsuba

        mitsuba.check()


def _check_beside(config: Config) -> None:
    """Other methods are lit from far away, on one atlas, with light between surfaces."""
    options = config.data_driven
    expected = {
        "data_driven.size": (options.size, config.atlas.size),
        "transfer.transport": (config.transfer.transport, "interreflected"),
        "data_driven.renderer": (options.renderer, BOUNCES),
        "data_driven.bounces": (options.bounces, config.transfer.bounces),
        "data_driven.keyframes": (list(options.keyframes), []),
    }
    for key, (found, wanted) in expected.items():
        if found != wanted:
            raise PrtnetError(
                f"{key}: found {found}, expected {wanted} where data_driven stands beside other methods; name it alone"
                " (methods=[data_driven]) for another"
            )
    if options.scenario != ["environment"]:
        raise PrtnetError(
            f"data_driven.scenario: found {options.scenario}, expected [environment] beside methods that know light"
            " from far away only; name data_driven alone for lamps"
        )
