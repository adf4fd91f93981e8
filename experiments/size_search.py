"""Does the search for a size choose what the full sweep would choose, and for how much less?

    python experiments/size_search.py plants=38 room=40 -- train.cpu_seconds=12 "size.widths=[8,16,32,64]"

For each SCENE=TARGET (dB) runs stage `size`, then trains all of its candidates in full on the same bake and in the same
store, and writes experiments/size_search/results/: a CSV of the candidates of each scene, its chart, and summary.md.
What stands after `--` are keys of the job. A killed run goes on.
"""

import csv
import json
import logging
import shutil
import sys
from pathlib import Path
from typing import Any

from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from prtnet import PrtnetError, cli, config, sh, store
from prtnet.chart import tables
from prtnet.pipeline import bake, candidates, job, run, trials
from prtnet.size import within

RESULTS = Path(__file__).parent / "size_search" / "results"
TITLES = (
    "scene",
    "target",
    "the search chose",
    "PSNR",
    "the cheapest of the sweep",
    "PSNR",
    "search",
    "sweep",
    "ratio",
)


def study(scene: str, target: float, words: list[str]) -> list[str]:
    """Search and sweep one scene: its line of the summary."""
    options = options_of(
        [f"scene={scene}", f"size.target_psnr={target}", "stages=[size]", f"out=runs/size/{scene}", *words]
    )
    out = Path(options.out or "")
    (out / "size.json").unlink(missing_ok=True)
    try:
        run(options, " ".join(["prtnet", f"scene={scene}", *words]))
    except PrtnetError as error:
        # where no candidate meets the target the report is there all the same
        if not (out / "size.json").exists():
            raise
        print(error)
    found = json.loads((out / "size.json").read_text())
    swept = sweep(options)
    keep(scene, found, swept)
    shutil.copy(out / "size.png", RESULTS / f"{scene}.png")
    meeting = [name for name, (psnr, _) in swept.items() if psnr >= target]
    best = meeting[0] if meeting else None
    spent, whole = found["cpu_seconds"], sum(seconds for _, seconds in swept.values())
    return [
        scene,
        f"{target:g}",
        *(
            text
            for name in (found["choice"], best)
            for text in (name or "none", f"{swept[name][0]:.2f}" if name else "-")
        ),
        tables.duration(spent),
        tables.duration(whole),
        f"{spent / whole:.0%}",
    ]


def options_of(words: list[str]) -> config.Config:
    config.register()
    with initialize_config_dir(str(cli.config_folder()), version_base="1.3"):
        options = OmegaConf.to_object(compose("config", words))
    assert isinstance(options, config.Config)
    return options


def sweep(options: config.Config) -> dict[str, tuple[float, float]]:
    """Name -> PSNR and CPU-seconds of every candidate in full, the cheapest first."""
    made = job.open_job(options, "", None)
    baked = bake.bake(made)
    assert baked.points is not None
    trial = trials.Trials(made, baked, baked.points)
    fit, _ = candidates.space(options, made.groups * sh.count(options.transfer.bands), made.shading_macs)
    size, found = options.size, {}
    for each in within(fit, max_macs=size.max_macs, max_bytes=size.max_bytes, cost=size.cost):
        reached = trial(each, 1.0)
        found[each.name] = (reached.psnr if size.view == "mean" else reached.psnr_worst), reached.cpu_seconds
    return found


def keep(scene: str, found: dict[str, Any], swept: dict[str, tuple[float, float]]) -> None:
    """A line for each candidate: what the search saw of it, and what it reaches in full."""
    RESULTS.mkdir(parents=True, exist_ok=True)
    shares = {name: max((t["share"], t["psnr"]) for t in found["trials"] if t["candidate"] == name) for name in
              {t["candidate"] for t in found["trials"]}}  # fmt: skip
    with (RESULTS / f"{scene}.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["network", "macs", "bytes", "share", "psnr", "expected", "spread", "verdict", "full", "cpu"])
        for each in found["candidates"]:
            share, psnr = shares.get(each["name"], (0, None))
            full, seconds = swept[each["name"]]
            seen = [each["expected"], each["spread"], each["verdict"], full, seconds]
            known = [share, psnr, *seen]
            cells = [f"{value:.4g}" if isinstance(value, float) else value for value in known]
            writer.writerow([each["name"], each["macs"], each["bytes"], *cells])


def main(arguments: list[str]) -> None:
    place = arguments.index("--") if "--" in arguments else len(arguments)
    pairs = [argument.split("=") for argument in arguments[:place]]
    if not pairs or any(len(pair) != 2 for pair in pairs):
        sys.exit(__doc__)
    logging.basicConfig(level=logging.INFO, format="%(message)s", stream=sys.stdout)
    lines = [study(scene, float(target), arguments[place + 1 :]) for scene, target in pairs]
    rows = [list(TITLES), ["---"] * len(TITLES), *lines]
    text = "\n".join(f"| {' | '.join(row)} |" for row in rows)
    store.write_text(RESULTS / "summary.md", f"`python experiments/size_search.py {' '.join(arguments)}`\n\n{text}\n")
    print(text)


if __name__ == "__main__":
    main(sys.argv[1:])
