"""What an export leaves of a network in each form, and that nothing stays of one that fails."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from prtnet import PrtnetError, netspec
from prtnet.export import certificate, cuda, cuda_file, cuda_host, form, weight_texture
from prtnet.export.bundle import NAMES, WEIGHTS
from prtnet.export.form import Form
from prtnet.pipeline import run
from prtnet.render import verify
from tests.cuda.host import needs_compiler
from tests.nets import random_points
from tests.pipeline.test_pipeline import config


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    """A run with literals."""
    out = tmp_path_factory.mktemp("base")
    run(config(out, stages=["export"], methods=["texture", "net"]))
    return out


def exported(base: Path, out: Path, **options: object) -> dict:
    """The certificate of the same network in another form."""
    changes = {f"export__{key}": value for key, value in options.items()}
    made = config(out, stages=["export"], methods=["texture", "net"], cache=str(base / "cache"), **changes)
    run(made)
    return certificate.check(out)


def written(out: Path) -> set[str]:
    names = (*NAMES, *cuda_file.NAMES, "net.safetensors", certificate.NAME)
    return {name for name in names if (out / name).exists()}


def test_the_certificate_of_literals(base):
    found = certificate.check(base)
    assert found["form"] == {"storage": "literal", "version": "330", "precision": "float32", "digits": 9}
    assert set(found["files"]) == written(base) - {certificate.NAME}
    assert set(NAMES) - written(base) == {WEIGHTS}
    assert found["executed"]
    assert found["device"]
    assert found["points"]["cube"] == 16_384
    assert found["net"]["sha256"] == netspec.checksum(netspec.load(base / "net.safetensors"))
    names = {"coefficients", "diffuse shading", "glossy shading", "diffuse shading, light folded", "torch"}
    assert set(found["errors"]) == names
    for each in found["errors"].values():
        assert 0 < each["mean"] <= each["max"] < each.get("bound", 1e-5) < 1e-3
    assert found["timing"]["milliseconds"] > 0
    assert found["timing"]["frame"][0] ** 2 >= found["points"]["cube"]


def test_a_weight_texture_in_half_precision(base, tmp_path):
    found = exported(base, tmp_path, storage="texture", precision="float16", version="300 es")
    loss = found["errors"]["rounding of the weights"]
    assert 1e-5 < loss["mean"] < 1e-2
    assert found["errors"]["coefficients"]["max"] <= 1e-5
    net = netspec.load(tmp_path / "net.safetensors")
    image = weight_texture.texels(form.rounded(net, Form(storage="texture", precision="float16")), "float16")
    assert (tmp_path / WEIGHTS).read_bytes() == image.tobytes()
    assert (tmp_path / "shading.frag").read_text().startswith("#version 300 es\n")


def test_digits_and_what_they_cost(base, tmp_path):
    found = exported(base, tmp_path, digits=5)
    assert 1e-7 < found["errors"]["rounding of the weights"]["max"] < 1e-3
    assert found["errors"]["coefficients"]["max"] <= 1e-5
    assert (tmp_path / "transfer.glsl").stat().st_size < 0.9 * (base / "transfer.glsl").stat().st_size


def test_uniform_blocks_are_validated_and_say_so(base, tmp_path):
    found = exported(base, tmp_path, storage="ubo")
    assert not found["executed"]
    assert "not run" in found["reason"]
    assert found["validated"] == bool(shutil.which("glslangValidator"))
    assert len((tmp_path / WEIGHTS).read_bytes()) % 16 == 0


def test_files_of_another_form_do_not_stay(base, tmp_path):
    exported(base, tmp_path, storage="texture")
    (tmp_path / "export.json").write_text("{}")
    assert WEIGHTS in written(tmp_path)
    exported(base, tmp_path)
    assert written(tmp_path) == written(base)
    assert not (tmp_path / "export.json").exists()


def test_an_error_above_its_bound_leaves_nothing(base, tmp_path, monkeypatch):
    exported(base, tmp_path, storage="texture")
    monkeypatch.setattr(verify, "TOLERANCE", 1e-9)
    with pytest.raises(PrtnetError, match=r"coefficients: found an error of .*e-0\d, expected at most 1e-09; nothing"):
        exported(base, tmp_path, digits=8)
    assert not written(tmp_path)


@pytest.mark.parametrize("name", ["net.safetensors", "transfer.glsl"])
@pytest.mark.parametrize("change", ["edit", "cut", "delete"])
def test_edited_files_are_found(base, tmp_path, name, change):
    shutil.copytree(base, tmp_path, dirs_exist_ok=True, ignore=shutil.ignore_patterns("cache"))
    data = (tmp_path / name).read_bytes()
    edited = data[:-1] + bytes([data[-1] ^ 1])
    (tmp_path / name).write_bytes(edited if change == "edit" else data[:-4])
    if change == "delete":
        (tmp_path / name).unlink()
    with pytest.raises(PrtnetError, match=f"{name}: .*export again"):
        certificate.check(tmp_path)


def test_a_certificate_that_is_none_is_refused(tmp_path):
    with pytest.raises(PrtnetError, match="not a readable certificate"):
        certificate.check(tmp_path)
    for text in ("[]", json.dumps({"format": 2}), "{"):
        (tmp_path / certificate.NAME).write_text(text)
        with pytest.raises(PrtnetError, match=r"certificate.*export again"):
            certificate.check(tmp_path)


def test_no_number_is_no_pass():
    with pytest.raises(PrtnetError, match="found an error of nan"):
        certificate.refuse({"coefficients": {"max": float(np.nan), "mean": 0.0, "bound": 1.0}})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"export__storage": "ssbo"}, "export.storage: found 'ssbo', expected one of auto, literal, texture, ubo"),
        ({"export__version": "310"}, "export.version: found '310'"),
        ({"export__precision": "half"}, "export.precision: found 'half'"),
        ({"export__digits": 20}, "export.digits: found 20"),
        ({"export__storage": "literal", "model__width": 300, "model__depth": 2}, "export.storage=texture"),
    ],
)
def test_bad_words_are_refused_before_any_work(changes, message, tmp_path):
    with pytest.raises(PrtnetError, match=message):
        run(config(tmp_path, **changes))
    assert not (tmp_path / "cache").exists()


@needs_compiler
def test_kernels_are_measured_and_compute_the_net(base, tmp_path):
    found = exported(base, tmp_path, cuda=True)
    assert found["cuda"]["executed"]
    assert found["cuda"]["compiler"]
    error = found["cuda"]["errors"]["coefficients"]
    assert 0 < error["mean"] < error["max"] <= error["bound"] == 1e-5
    assert set(cuda_file.NAMES) < set(found["files"])
    # as another program takes them: the text, the buffer and the structure
    net, points = netspec.load(tmp_path / "net.safetensors"), random_points(200)
    library = cuda_host.build((tmp_path / cuda_file.SOURCE).read_text(), tmp_path / "kernels.so")
    buffer = np.fromfile(tmp_path / cuda_file.PARAMETERS, "<f4")
    computed = cuda_host.HostKernels(net, library, buffer).transfer(*points)
    np.testing.assert_allclose(computed, netspec.evaluate_unit(net, *points), atol=1e-5)
    # and without them nothing of them stays
    assert "cuda" not in exported(base, tmp_path)
    assert written(tmp_path) == written(base)


@needs_compiler
def test_a_kernel_that_is_wrong_leaves_nothing(base, tmp_path, monkeypatch):
    exported(base, tmp_path, cuda=True)
    source = cuda.source
    monkeypatch.setattr(cuda, "source", lambda net: source(net).replace("octave = 0.5f", "octave = 0.25f"))
    with pytest.raises(PrtnetError, match=r"CUDA kernel, compiled by .*found an error of .*export\.cuda=false"):
        exported(base, tmp_path, cuda=True)
    assert not written(tmp_path)


def test_kernels_that_were_not_run_say_so(base, tmp_path, monkeypatch):
    monkeypatch.setattr(cuda_host, "compiler", lambda: None)
    monkeypatch.setattr(shutil, "which", lambda name: None)
    found = exported(base, tmp_path, cuda=True)["cuda"]
    assert found == {"validated": False, "executed": False, "reason": "not run: found no g++ or clang++"}
    assert (tmp_path / cuda_file.SOURCE).exists()
