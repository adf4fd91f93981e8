"""The context, row order, timing, messages."""

import threading

import moderngl
import numpy as np
import pytest

from prtnet import PrtnetError, gl

COPY = (
    "uniform sampler2D image; out vec4 colour; void main() { colour = texelFetch(image, ivec2(gl_FragCoord.xy), 0); }"
)
UV = "in vec2 uv; out vec4 colour; void main() { colour = vec4(uv, 0.0, 1.0); }"


def test_one_context_per_thread():
    found = []
    assert gl.context() is gl.context()
    thread = threading.Thread(target=lambda: found.append(gl.context()))
    thread.start()
    thread.join()
    assert found[0] is not gl.context()


def test_a_windows_context_is_drawn_with_until_it_closes():
    """In a thread, whose contexts are its own."""
    found = []

    def failing() -> moderngl.Context:
        raise PrtnetError("no window")

    def draw() -> None:
        before = gl.context()
        gl.target(4, 4).clear()
        with gl.adopted(gl._create):
            inside, target = gl.context(), gl.target(4, 4)
            gl.fullscreen(gl.program(gl.shader("fullscreen.vert.glsl"), UV), target)
            found.append(target.read()[..., 3].min())
            assert gl.context() is inside
        with pytest.raises(PrtnetError, match="no window"), gl.adopted(failing):
            pass
        gl.target(4, 4).clear()
        found.append(len({id(each) for each in (before, inside, gl.context())}))

    thread = threading.Thread(target=draw)
    thread.start()
    thread.join()
    assert found == [1, 3]


def test_missing_libraries_name_the_line_to_type(monkeypatch):
    monkeypatch.setattr(gl, "_cache", threading.local())
    monkeypatch.setitem(gl.EGL, "libegl", "libNoSuchEGL.so.1")
    with pytest.raises(PrtnetError, match="apt-get install libegl1 libgl1"):
        gl.context()


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_upload_and_read_keep_rows(channels):
    image = np.random.default_rng(0).random((5, 7, channels), np.float32)
    target, program = gl.target(7, 5), gl.program(gl.shader("fullscreen.vert.glsl"), COPY)
    texture = gl.upload(image)
    texture.use(0)
    gl.put(program, image=0)
    target.clear()
    gl.fullscreen(program, target)
    np.testing.assert_array_equal(target.read()[..., :channels], image)


def test_layers_keep_rows_and_are_padded():
    image = np.random.default_rng(0).random((4, 4, 6), np.float32)
    made = gl.upload_layers([image])
    data = np.frombuffer(made.read(), np.float32).reshape(2, 4, 4, 4)
    np.testing.assert_array_equal(data[0, ::-1], image[..., :4])
    np.testing.assert_array_equal(data[1, ::-1, :, :2], image[..., 4:])
    assert not data[1, ..., 2:].any()


def test_v_is_up():
    target, program = gl.target(8, 8), gl.program(gl.shader("fullscreen.vert.glsl"), UV)
    gl.fullscreen(program, target)
    image, centres = target.read(), (np.arange(8) + 0.5) / 8
    np.testing.assert_allclose(image[:, 0, 1], 1 - centres, atol=1e-6)
    np.testing.assert_allclose(image[0, :, 0], centres, atol=1e-6)


def test_compiler_message_reaches_the_user():
    with pytest.raises(PrtnetError, match="no_such_name"):
        gl.program(gl.shader("fullscreen.vert.glsl"), "out vec4 c; void main() { c = vec4(no_such_name); }")


def test_too_large_a_target():
    with pytest.raises(PrtnetError, match="image size"):
        gl.target(10**6, 4)


def test_milliseconds_counts_draws():
    calls = []
    assert gl.milliseconds(lambda: calls.append(1), repeats=3) >= 0
    assert len(calls) == 4
    assert gl.context().error == "GL_NO_ERROR"
    assert isinstance(gl.context(), moderngl.Context)
