"""Shapes, types and threads of arrays."""

import os
import signal
import threading
import time

import numpy as np
import pytest

import plywave


def test_shapes_broadcast(polyester, jersey):
    w = np.zeros((5, 1, 3)) + [0.0, 0.6, 0.8]
    f = polyester.eval(np.linspace(0, 1, 4), 3.0, w, np.full((2, 1, 1, 3), 0.01))
    assert f.shape == (2, 5, 4, 3) and f.dtype == np.float32
    assert polyester.pdf(np.linspace(0, 1, 4), 3.0, w, 0.01).shape == (5, 4)
    assert polyester.eval(0.1, 0.0, [0, 1, 0], 0.01).shape == (1,)
    assert polyester.eval(0.1, 0.0, [0, 1, 0], 0.01, [0.4, 0.5, 0.6, 0.7]).shape == (4,)
    assert polyester.albedo(np.zeros((2, 3)), 0.0, [0.0] * 8).shape == (2, 3, 8)
    assert polyester.sample(0.1, 0.0, np.full((7, 3), 0.5), [0.1, 0.2]).weight.shape == (7, 2)
    assert polyester.r_d(np.zeros((2, 1)), np.zeros(3)).shape == (2, 3)
    assert jersey.eval(np.zeros((6, 1, 2)), [0, 0, 1.0], np.full((4, 3), 0.577)).shape == (6, 4, 3)
    assert jersey.is_gap(np.zeros((6, 2)), [0, 0, 1.0]).dtype == bool
    # Values are those of the spread out arrays.
    t, h = np.meshgrid(np.linspace(0, 1, 4), np.linspace(-20, 20, 5))
    spread = polyester.eval(t, h, np.broadcast_to([0.0, 0.6, 0.8], (5, 4, 3)), [0.01, 0.02])
    np.testing.assert_array_equal(polyester.eval(np.linspace(0, 1, 4), np.linspace(-20, 20, 5)[:, None], [0.0, 0.6, 0.8], [0.01, 0.02]), spread)


@pytest.mark.parametrize("shape", [(0,), (3, 0), (0, 4)])
def test_empty_arrays_give_empty_results(polyester, jersey, fiber, shape):
    assert polyester.eval(np.zeros(shape), 0.0, [0.0, 1.0, 0.0], [0.01, 0.02]).shape == (*shape, 2)
    assert polyester.sample(np.zeros(shape), 0.0, [0.5] * 3, 0.0).event.shape == shape
    assert jersey.eval(np.zeros((*shape, 2)), [0, 0, 1.0], [0, 0, 1.0]).shape == (*shape, 3)
    assert fiber.pdf(np.zeros((*shape, 3)), [0.0, 1.0, 0.0], 0.5).shape == shape


def test_other_floats_and_layouts(polyester):
    rng = np.random.default_rng(1)
    w = rng.normal(size=(3, 1000))
    w /= np.linalg.norm(w, axis=0)
    theta_i = np.linspace(0, 1, 1000)
    sigma = np.full((1000, 2), 0.0078125)
    want = polyester.eval(theta_i.astype(np.float32), 0.0, np.ascontiguousarray(w.T).astype(np.float32), sigma)
    for t, d, s in [
        (theta_i.astype(np.float32), w.T.astype(np.float32), sigma),
        (np.repeat(theta_i, 2)[::2], w.T, sigma[::-1]),
        (theta_i.astype(">f8"), np.asfortranarray(w.T), sigma.astype(np.float16)),
        (theta_i.astype(np.longdouble), w.T.tolist(), 0.0078125),
    ]:
        np.testing.assert_allclose(np.broadcast_to(polyester.eval(t, 0.0, d, s), want.shape), want, rtol=2e-5, atol=1e-7)
    frozen = theta_i.copy()
    frozen.flags.writeable = False
    polyester.eval(frozen, 0.0, w.T, sigma)


def refused(call, *parts):
    with pytest.raises(plywave.Error) as raised:
        call()
    message = str(raised.value)
    assert isinstance(raised.value, ValueError) and "\n" not in message
    for part in parts:
        assert part in message, message


def test_what_is_no_array_of_floats_is_refused(polyester, jersey):
    w = np.array([0.0, 1.0, 0.0])
    eval_ = polyester.eval
    refused(lambda: eval_(np.arange(3), 0.0, w, 0.0), "theta_i", "int64", "(3,)", "float32")
    refused(lambda: eval_(np.array([1j]), 0.0, w, 0.0), "theta_i", "complex128")
    refused(lambda: eval_(0.0, np.array([None]), w, 0.0), "h_um", "object")
    refused(lambda: eval_(0.0, np.array([True]), w, 0.0), "h_um", "bool")
    refused(lambda: eval_("0.3", 0.0, w, 0.0), "theta_i")
    refused(lambda: eval_([[1.0], [1.0, 2.0]], 0.0, w, 0.0), "theta_i")
    refused(lambda: eval_(None, 0.0, w, 0.0), "theta_i")
    refused(lambda: eval_(0.0, 0.0, w, np.zeros(2, "U3")), "sigma_per_um")
    refused(lambda: eval_(0.0, 0.0, np.zeros((4, 2)), 0.0), "omega_o", "(4, 2)", "[..., 3]")
    refused(lambda: eval_(0.0, 0.0, 1.0, 0.0), "omega_o", "()")
    refused(lambda: eval_(np.zeros(3), 0.0, np.zeros((4, 3)), 0.0), "theta_i (3,)", "omega_o (4, 3)")
    refused(lambda: eval_(0.0, 0.0, w, [0.0, 0.1], [0.4, 0.5, 0.6]), "sigma_per_um (2,)", "lambda_um (3,)")
    refused(lambda: eval_(0.0, 0.0, w, np.zeros(9)), "(9,)", "1 to 8")
    refused(lambda: eval_(0.0, 0.0, w, np.zeros(0)), "1 to 8")
    refused(lambda: eval_(0.0, 0.0, w, 0.0, place=plywave.Place(-1)), "place.ply")
    refused(lambda: eval_(0.0, 0.0, w, 0.0, place=plywave.Place(0.5)), "place.ply", "float64")
    refused(lambda: eval_(0.0, 0.0, w, 0.0, place=1), "place", "give a Place")
    refused(lambda: jersey.eval([0.0, 0.0, 0.0], w, w), "position_um", "[..., 2]")
    refused(lambda: jersey.eval([0.0, 0.0], w, w, sigma_per_um=[0.1, 0.2]), "sigma_per_um", "(2,)")
    refused(lambda: jersey.with_colors([0.5, 0.5], None), "warp")
    refused(lambda: jersey.with_colors([0.5, 0.5, 1.5], None), "warp", "0 to 1")
    refused(lambda: jersey.with_colors(None, None, "sunset"), "sunset", "even_sky")


def test_arrays_beyond_memory_are_refused(polyester):
    """A call that would need 4 TB raises; the process goes on."""
    with pytest.raises((MemoryError, plywave.Error)):
        polyester.eval(np.zeros((1_000_000, 1)), np.zeros(1_000_000), [0.0, 1.0, 0.0], 0.0)
    huge = np.broadcast_to(np.float32(0.3), (1 << 40,))
    with pytest.raises((MemoryError, plywave.Error)):
        polyester.eval(huge, 0.0, [0.0, 1.0, 0.0], 0.0)


def test_results_do_not_depend_on_threads(polyester, jersey):
    rng = np.random.default_rng(9)
    n = 30000
    w = rng.normal(size=(n, 3))
    w /= np.linalg.norm(w, axis=1, keepdims=True)
    theta_i, h_um, sigma, u = rng.uniform(0, 1.4, n), rng.uniform(-60, 60, n), rng.uniform(0, 0.02, (n, 3)), rng.uniform(size=(n, 3))
    position = rng.uniform(0, 3000, (n // 10, 2))
    results = []
    for threads in (1, 2, 5):
        plywave.set_threads(threads)
        assert plywave.get_threads() == threads
        results.append(
            [
                polyester.eval(theta_i, h_um, w, sigma),
                polyester.eval(theta_i, h_um, w, sigma, edge=False),
                *polyester.eval_pdf(0.3, 2.0, w, [0.1, 0.2]),
                *polyester.sample(theta_i, h_um, u, sigma),
                jersey.eval(position, [0.0, 0.6, 0.8], w[: n // 10]),
            ]
        )
    for other in results[1:]:
        for a, b in zip(results[0], other):
            np.testing.assert_array_equal(a, b)
    refused(lambda: plywave.set_threads(0), "threads = 0")
    refused(lambda: plywave.set_threads(2.5), "threads = 2.5")


def test_the_lock_of_the_interpreter_is_released(jersey):
    """Another thread of Python goes on while a long call runs."""
    plywave.set_threads(1)
    position = np.random.default_rng(1).uniform(0, 3000, (200_000, 2))
    ticks, stop = [], threading.Event()

    def tick():
        while not stop.is_set():
            ticks.append(time.monotonic())
            time.sleep(0.002)

    thread = threading.Thread(target=tick)
    thread.start()
    begun = time.monotonic()
    jersey.eval(position, [0.0, 0.6, 0.8], [0.3, 0.0, 0.954])
    ended = time.monotonic()
    stop.set()
    thread.join()
    within = [t for t in ticks if begun < t < ended]
    assert ended - begun > 0.05 and len(within) > 5, (ended - begun, len(within))


@pytest.mark.skipif(os.name != "posix", reason="sends SIGINT")
def test_long_calls_stop(jersey):
    """Ctrl-C reaches a call that would take minutes."""
    position = np.random.default_rng(1).uniform(0, 3000, (20_000_000, 2)).astype(np.float32)
    timer = threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    begun = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        jersey.albedo(position, [0.0, 0.6, 0.8])
    assert time.monotonic() - begun < 5.0


@pytest.mark.skipif(not hasattr(os, "fork"), reason="forks")
def test_calls_work_after_a_fork(polyester, tiny):
    w = np.random.default_rng(1).normal(size=(10000, 3))
    w /= np.linalg.norm(w, axis=1, keepdims=True)
    plywave.set_threads(2)
    want = polyester.eval(0.3, 0.0, w, 0.01)
    child = os.fork()
    if child == 0:
        os._exit(0 if np.array_equal(polyester.eval(0.3, 0.0, w, 0.01), want) else 3)
    assert os.waitpid(child, 0)[1] == 0
