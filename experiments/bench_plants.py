"""What trained nets cost where they go, for `bench.py export`: small decoders with texels on plants, and the web page.

Runs of the command line in processes of their own, below runs/; what an earlier one or the study of exports has baked
and trained is not done again.
"""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

from prtnet import score
from prtnet.export import browser
from prtnet.pipeline import web

RUNS = Path("runs")
FRAMES = Path(__file__).parent / "exports" / "frames.py"
WORDS = ("texels", "texels_32x2", "texels_16x2")
SECONDS = 30  # of training
REST = 2.0  # seconds in which nothing happens
PATIENCE = 60.0  # seconds to wait for the last frame
Row = dict[str, str | float]


def decoders(*changes: str) -> list[Row]:
    """PSNR of diffuse nets with features over the atlas, from 64 x 4 to 16 x 2, and CPU time of a frame of 512^2 in one
    thread, over that of the texture method in the same process."""
    out = RUNS / "exports_texels"
    _prtnet(f"ablation={','.join(WORDS)}", f"train.cpu_seconds={SECONDS}", f"out={out}", *changes)
    _run(str(FRAMES), str(out), "512")
    rows: list[Row] = []
    for point in sorted(out.glob("ablation=*")):
        found, _ = score.read(point / "score.json")
        taken = json.loads((point / "frames.json").read_text())
        figures = {f"{row.method}: PSNR against traced, dB": row.psnr for row in found if _is_method(row)}
        figures |= {f"{name}, 512^2, CPU-ms": taken[name] for name in ("net", "texture")}
        figures["net / texture"] = taken["ratio"]
        scene = f"{found[0].scene}, {point.name.partition('=')[2]}"
        rows += [{"scene": scene, "what": what, "value": value or 0.0} for what, value in figures.items()]
    return rows


def _is_method(row: score.Row) -> bool:
    return row.is_method and row.reference == "traced"


def page(*changes: str) -> list[Row]:
    """The web page of the default net with a texture of 512^2: bytes, seconds to its pictures in Chromium, and frames
    drawn while it is left alone. Nothing where there is no Chromium."""
    if browser.find() is None:
        return []
    out = RUNS / "exports_page"
    _prtnet("ablation=none", "export=web", f"out={out}", *changes)
    file = out / web.NAME  # a sweep of one point has no folders below it
    facts = web.measure(file)
    found = {
        "size, MB": file.stat().st_size / 1e6,
        "first picture, wall s": facts["first_seconds"],
        "network's picture, wall s": facts["ready_seconds"],
        f"frames in {REST:g} s of rest": _frames_at_rest(file),
        "net / texture": facts["net_ms"] / facts["texture_ms"],
        "error of a coefficient, 1e-6": 1e6 * facts["error_max"],
    }
    scene = f"page, {facts['browser']}"
    return [{"scene": scene, "what": what, "value": value} for what, value in found.items()]


def _frames_at_rest(file: Path) -> int:
    """Frames that a page draws by itself once its last one is there."""
    with browser.Browser(size=web.FRAME) as found:
        found.goto(file.resolve().as_uri())
        found.evaluate("prtnet.ready")
        deadline = time.monotonic() + PATIENCE
        while found.evaluate("prtnet.viewer.pending") and time.monotonic() < deadline:
            time.sleep(0.1)
        before = found.evaluate("prtnet.viewer.frames")
        time.sleep(REST)
        return found.evaluate("prtnet.viewer.frames") - before


def _prtnet(*words: str) -> None:
    _run("-m", "prtnet", "-m", "experiment=exports", *words)


def _run(*words: str) -> None:
    """Python, its drawing in one thread."""
    environment = os.environ | {"LP_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    subprocess.run([sys.executable, *words], env=environment, check=True, stdout=subprocess.DEVNULL)


if __name__ == "__main__":
    print(json.dumps([*decoders(*sys.argv[1:]), *page(*sys.argv[1:])], indent=1))
