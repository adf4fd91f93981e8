"""Stage `size`: the cheapest network that meets a target on this scene, or the best within a budget."""

import json
import logging
import shlex
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any

from prtnet import PrtnetError, console, sh, store
from prtnet.chart import size as chart
from prtnet.pipeline import candidates
from prtnet.pipeline.bake import Baked
from prtnet.pipeline.job import Job
from prtnet.pipeline.trials import Trials
from prtnet.size import Candidate, Found, Tried, search

log = logging.getLogger(__name__)


def size(job: Job, baked: Baked) -> Job:
    """The job with the network that was chosen. Leaves size.json, size.md and size.png in the run folder.

    Raises PrtnetError, after these are written, where no candidate meets the target.
    """
    assert baked.points is not None
    found = chosen(job, Trials(job, baked, baked.points))
    return replace(job, config=candidates.configured(job.config, found))


def chosen(job: Job, trials: Trials, *, alone: bool = True) -> Candidate:
    """The network of a job, or of one cluster of its scene, which no command line makes `alone`. Leaves size.json,
    size.md and size.png in the job's folder; raises PrtnetError, after these are written, where none meets the target.
    """
    options = job.config.size
    fit, large = candidates.space(job.config, job.groups * sh.count(job.config.transfer.bands), job.shading_macs)
    for each in large:
        log.info("size: %s is too large to export as literals, and left out", each.name)
    floor = trials.floor()
    log.info("size: %d candidates; noise floor %.1f dB", len(fit), floor)
    found = search(
        fit,
        trials,
        target=options.target_psnr,
        max_macs=options.max_macs,
        max_bytes=options.max_bytes,
        cost=options.cost,
        view=options.view,
        floor=floor,
        on_trial=_teller(),
    )
    _report(job, found, floor, alone)
    if found.choice is None:
        raise PrtnetError(f"size: {found.reason}. {_limits(found)} What was tried stands in {job.out / 'size.md'}")
    return found.choice


def command(job: Job, choice: Candidate) -> str:
    """The command line that trains, exports and scores that network, and nothing else."""
    given = shlex.split(job.command or "prtnet")
    kept = [
        word for word in given if not word.startswith(("stages=", "size.", *(f"{key}=" for key in choice.settings)))
    ]
    made = [f"{key}={str(value).replace(' ', '')}" for key, value in choice.settings.items()]
    return shlex.join([*kept, *made, "stages=[score]"])


def _teller() -> Callable[[Tried, float], None]:
    """A line for each trial, with the rate of trials and about how long the rest takes."""
    started, spent, trained, count = time.monotonic(), 0.0, 0.0, 0

    def tell(tried: Tried, to_come: float) -> None:
        nonlocal spent, trained, count
        spent, trained, count = spent + tried.trial.cpu_seconds, trained + tried.share, count + 1
        share = "in full" if tried.share == 1 else f"with 1/{1 / tried.share:.0f} of the training"
        expected = f", expected {tried.expected:.1f} +- {tried.spread:.1f} in full" if tried.spread else ""
        minutes = max(time.monotonic() - started, 1e-3) / 60
        log.info(
            "size: trial %d: %s %s: %.2f dB%s; %.1f trials a minute, about %s of training to come",
            count,
            tried.candidate.name,
            share,
            tried.psnr,
            expected,
            count / minutes,
            console.duration(to_come * spent / trained),
        )

    return tell


def _report(job: Job, found: Found, floor: float, alone: bool) -> None:
    """The table on the terminal, and the files."""
    options, out = job.config.size, job.out
    target, words = options.target_psnr, _words(job, found, floor)
    made = command(job, found.choice) if found.choice and alone else None
    end = [_limits(found)] if found.choice is None else [made] if made else []
    print("\n".join([chart.table(found, target), "", *words, *end]))
    store.write_text(out / "size.json", json.dumps(_facts(job, found, floor, made), indent=1) + "\n")
    title = f"# The size of a network for {'' if alone else f'cluster {out.name} of '}{job.scene.name}"
    body = [title, *words, *([f"`{made}`"] if made else end), chart.markdown(found, target)]
    store.write_text(out / "size.md", "\n\n".join([*body, "![PSNR against cost](size.png)\n"]))
    chart.picture(out / "size.png", found, target=target, floor=floor, cost=options.cost)


def _words(job: Job, found: Found, floor: float) -> list[str]:
    """What was asked, what was found, why it ended, what it took."""
    options = job.config.size
    asked = [f"at least {options.target_psnr:g} dB in the {options.view} view"] if options.target_psnr else []
    asked += [f"at most {options.max_macs} multiply-adds per pixel"] if options.max_macs else []
    asked += [f"at most {options.max_bytes} bytes"] if options.max_bytes else []
    lines = [
        f"Asked: {', '.join(asked)}; {job.material.name} under {job.light_name}, against traced,"
        f" whose noise floor is {floor:.1f} dB. Cheaper means fewer {_unit(options.cost)}.",
        f"Found: {found.choice.name}, {found.choice.macs} multiply-adds per pixel, {found.choice.bytes} bytes."
        if found.choice
        else "Found: none.",
        f"Why it ended: {found.reason}.",
    ]
    if found.tried:
        share = found.cpu_seconds / max(found.sweep_seconds, 1e-9)
        lines.append(
            f"Cost: {len(found.tried)} trials of {len({each.candidate for each in found.tried})} networks,"
            f" {console.duration(found.cpu_seconds)} of CPU time; all {len(found.candidates)} in full would take about"
            f" {console.duration(found.sweep_seconds)} ({share:.0%})."
        )
    return lines


def _limits(found: Found) -> str:
    return " ".join(f"Limit: {name}: {words}." for name, words in found.limits.items())


def _unit(cost: str) -> str:
    first, second = ("multiply-adds per pixel", "bytes")[:: 1 if cost == "macs" else -1]
    return f"{first}, then fewer {second}"


def _facts(job: Job, found: Found, floor: float, made: str | None) -> dict[str, Any]:
    options = job.config.size
    return {
        "asked": asdict(options),
        "choice": found.choice and found.choice.name,
        "command": made,
        "reason": found.reason,
        "limits": dict(found.limits),
        "noise_floor": floor,
        "cpu_seconds": found.cpu_seconds,
        "sweep_cpu_seconds": found.sweep_seconds,
        "candidates": [
            asdict(each)
            | {
                "expected": found.expected.get(each.name, (None, None))[0],
                "spread": found.expected.get(each.name, (None, None))[1],
                "verdict": chart.verdict(found, each, options.target_psnr),
            }
            for each in found.candidates
        ],
        "trials": [
            asdict(each.trial)
            | {
                "candidate": each.candidate.name,
                "share": each.share,
                "expected": each.expected,
                "spread": each.spread,
            }
            for each in found.tried
        ],
    }
