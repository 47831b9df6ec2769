"""Relighting on a GPU, a software one too: the CPU's images, to rounding."""

import multiprocessing
import os

import ltm
import numpy as np
import pytest
from conftest import COLUMNS, HEIGHT, WIDTH, copy_of


@pytest.fixture
def random():
    return np.random.default_rng(11)


def nearly(found, wanted):
    # The same products of f32 in another order: 2^-17 of the largest pixel, as in the library's own test.
    np.testing.assert_allclose(found, wanted, rtol=0, atol=np.abs(wanted).max() / 131072)


@pytest.mark.parametrize("budgets", [{}, {"gpu_memory": 40_000}, {"memory": 20_000}, {"memory": 20_000, "gpu_memory": 40_000}])
def test_the_gpu_gives_the_images_of_the_cpu(adapter, container_path, random, budgets):
    weights = random.uniform(-1, 2, (5, COLUMNS, 3)).astype(np.float32)
    with ltm.open(container_path, **budgets) as m, ltm.open(container_path) as cpu:
        wanted = cpu.relight(weights, device="cpu")
        nearly(m.relight(weights, device="gpu"), wanted)
        nearly(m.relight(weights[2], device="gpu"), wanted[2])
        part = np.full((5, 23, 34, 3), np.nan, np.float32)
        assert m.relight(weights, roi=np.s_[10:33, 15:-1], out=part, device="gpu") is part
        np.testing.assert_array_equal(part, m.relight(weights, device="gpu")[:, 10:33, 15:-1])
        assert m.relight(weights[:0], device="gpu").shape == (0, HEIGHT, WIDTH, 3)


def test_auto_is_a_gpu_only_where_that_is_no_software_and_faster(adapter, container_path, random):
    weights = random.uniform(size=(COLUMNS, 3)).astype(np.float32)
    with ltm.open(container_path) as m:
        image = m.relight(weights)
        choices = [m.relight(weights, device="cpu")]
        if not adapter.is_software:
            choices.append(m.relight(weights, device="gpu"))
        assert any((image == choice).all() for choice in choices)
        # What was chosen stays.
        np.testing.assert_array_equal(m.relight(weights), image)


def test_a_stored_matrix_has_nothing_for_a_gpu(adapter, matrix_path):
    with ltm.open(matrix_path) as m:
        with pytest.raises(ValueError, match="pack it"):
            m.relight(np.ones(COLUMNS), device="gpu")
        assert m.relight(np.ones(COLUMNS), device="auto").any()


def test_damage_is_said_on_the_gpu_too(adapter, container_path, tmp_path):
    copy = copy_of(container_path, tmp_path)
    whole = bytearray(copy.read_bytes())
    whole[len(whole) // 2] ^= 0x55
    copy.write_bytes(whole)
    for device in ("cpu", "gpu", "auto"):
        with pytest.raises(ltm.DamagedError), ltm.open(copy) as m:
            m.relight(np.ones(COLUMNS), device=device)


def test_weights_are_checked_before_they_are_sent(adapter, container_path):
    with ltm.open(container_path) as m:
        for wrong in (np.full(COLUMNS, np.nan), np.ones(COLUMNS + 1)):
            with pytest.raises(ValueError):
                m.relight(wrong, device="gpu")
    with pytest.raises(ValueError, match="closed"):
        m.relight(np.ones(COLUMNS), device="gpu")


def forked(m, answers):
    try:
        m.relight(np.ones(COLUMNS), device="gpu")
    except ltm.NoGpuError as error:
        answers.put(str(error))
    answers.put(m.relight(np.ones(COLUMNS)).sum())
    m.close()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the system does not fork")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_forked_process_relights_on_the_cpu(adapter, container_path):
    context = multiprocessing.get_context("fork")
    answers = context.Queue()
    with ltm.open(container_path) as m:
        m.relight(np.ones(COLUMNS), device="gpu")
        child = context.Process(target=forked, args=(m, answers))
        child.start()
        assert "forked" in answers.get(timeout=60)
        assert answers.get(timeout=60) == m.relight(np.ones(COLUMNS)).sum()
        child.join(60)
        assert child.exitcode == 0
