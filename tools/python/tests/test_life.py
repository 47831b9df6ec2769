"""Errors of opening, closing, threads, processes."""

import concurrent.futures
import multiprocessing
import pickle
import threading
import time

import ltm
import numpy as np
import pytest
from conftest import COLUMNS, copy_of


def test_a_closed_matrix_refuses_everything(path):
    with ltm.open(path) as m:
        assert not m.closed
    assert m.closed and "closed" in repr(m)
    m.close()
    uses = [
        lambda: m[0],
        lambda: m.relight(np.ones(COLUMNS)),
        lambda: m.adjoint(np.ones(m.shape[:3])),
        lambda: m.attrs,
        lambda: m.blocks[0],
        lambda: m.lights,
        lambda: m.scene_weights,
        lambda: next(m.iter_blocks()),
        lambda: np.asarray(m),
        lambda: pickle.dumps(m),
    ]
    for use in uses:
        with pytest.raises(ValueError, match="closed"):
            use()


def test_files_that_cannot_be_opened(tmp_path):
    for name in ("none.ltm", "none.ltc", "none"):
        with pytest.raises(FileNotFoundError, match=name):
            ltm.open(tmp_path / name)
        (tmp_path / name).write_bytes(b"something else " * 1000)
        with pytest.raises(ValueError):
            ltm.open(tmp_path / name)
    with pytest.raises(ValueError, match="folder"):
        ltm.open(tmp_path)
    with pytest.raises(TypeError):
        ltm.open(7)


def test_a_file_is_known_by_what_it_holds(path, tmp_path):
    copy = copy_of(path, tmp_path).rename(tmp_path / "room")
    with ltm.open(copy) as m, ltm.open(path) as wanted:
        assert m.attrs["kind"] == wanted.attrs["kind"]


def test_a_file_that_is_cut_while_it_is_open(path, tmp_path):
    copy = copy_of(path, tmp_path)
    with ltm.open(copy) as m:
        with copy.open("r+b") as file:
            file.truncate(copy.stat().st_size // 8)
        with pytest.raises((ltm.DamagedError, OSError)):
            m[...]
        with pytest.raises((ltm.DamagedError, OSError)):
            m.relight(np.ones(COLUMNS))


def test_a_matrix_is_used_by_many_threads(m):
    weights = np.random.default_rng(0).uniform(size=(8, COLUMNS, 3)).astype(np.float32)
    x = np.ones(m.shape[:3], np.float32)
    with ltm.open(m.path) as other:
        wanted = [(other.relight(w), other[i], other.adjoint(x)) for i, w in enumerate(weights)]

    def work(i):
        return m.relight(weights[i % 8]), m[i % 8], m.adjoint(x)

    with concurrent.futures.ThreadPoolExecutor(8) as threads:
        for i, found in enumerate(threads.map(work, range(64))):
            for a, b in zip(found, wanted[i % 8], strict=True):
                np.testing.assert_array_equal(a, b)


def test_closing_waits_for_nobody_and_harms_nobody(path):
    m = ltm.open(path)
    errors = []

    def work():
        while True:
            try:
                m.relight(np.ones(COLUMNS))
            except ValueError as error:
                errors.append(str(error))
                return

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    time.sleep(0.2)
    m.close()
    for thread in threads:
        thread.join(10)
    assert len(errors) == 4 and all("closed" in error for error in errors)


def test_other_threads_run_while_a_matrix_is_made(tmp_path):
    ticks = []
    done = threading.Event()

    def tick():
        while not done.wait(0.002):
            ticks.append(time.monotonic())

    thread = threading.Thread(target=tick)
    thread.start()
    begun = time.monotonic()
    ltm.render(ltm.BuiltIn("diffuse", 96, 64, 4), tmp_path / "a.ltm", samples=256, block_side=16)
    took = time.monotonic() - begun
    done.set()
    thread.join()
    # It would not have ticked at all.
    assert len(ticks) > 20 * took


def test_a_matrix_pickles_as_its_path(m):
    data = pickle.dumps(m)
    assert len(data) < 500
    with pickle.loads(data) as again:
        np.testing.assert_array_equal(again[3], m[3])


def relit(m):
    return m.relight(np.ones(COLUMNS)), m.adjoint(np.ones(m.shape[:3])), m[5]


@pytest.mark.parametrize("method", ["fork", "spawn"])
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_processes_work(m, method):
    wanted = relit(m)
    # A forked process has not the threads of its parent.
    with multiprocessing.get_context(method).Pool(2) as pool:
        for found in pool.map_async(relit, [m] * 4).get(60):
            for a, b in zip(found, wanted, strict=True):
                np.testing.assert_array_equal(a, b)


def forked(results, m):
    results.put(relit(m)[0])


@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_a_matrix_that_was_open_before_the_fork_works_after_it(m):
    wanted = relit(m)[0]
    context = multiprocessing.get_context("fork")
    results = context.Queue()
    process = context.Process(target=forked, args=(results, m))
    process.start()
    np.testing.assert_array_equal(results.get(timeout=60), wanted)
    process.join()


def test_version_and_names():
    assert ltm.__version__ == "0.2.0"
    assert "mixed" in ltm.BUILT_IN_SCENES
    assert all(hasattr(ltm, name) for name in ltm.__all__)
    for name in ltm.__all__:
        assert name.startswith("__") or name == "BUILT_IN_SCENES" or getattr(ltm, name).__doc__
