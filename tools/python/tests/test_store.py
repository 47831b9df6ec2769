"""Shards and containers in an object store: moto's server as a process of its own, through a network that fails."""

import multiprocessing
import os
import pickle
import subprocess
import time
from pathlib import Path

import ltm
import numpy as np
import pytest
from stores import BUCKET, FAULTS, Network, ask, moto
from test_farm import MTL, OBJ, PROGRAM, SCENE, digest, run

needs_program = pytest.mark.skipif(PROGRAM is None, reason="the program ltm is not there, and LTM does not say where it is")


@pytest.fixture(scope="module")
def store():
    with moto() as port:
        yield port


@pytest.fixture
def network(store, monkeypatch):
    with Network(store) as network:
        for name, value in network.environment.items():
            monkeypatch.setenv(name, value)
        yield network


def put(store: int, name: str, data: bytes) -> str:
    assert ask(store, "PUT", f"/{BUCKET}/{name}", data)[0] == 200
    return f"s3://{BUCKET}/{name}"


@pytest.fixture(scope="module")
def large(tmp_path_factory) -> Path:
    """A container of some megabytes: noise does not compress."""
    path = tmp_path_factory.mktemp("large") / "noise.ltc"
    noise = np.random.default_rng(3).uniform(0.0, 1.0, (24, 256, 256, 3)).astype(np.float32)
    ltm.pack(noise, path, target="60dB", block_side=16)
    assert path.stat().st_size > 3 << 20
    return path


def test_what_a_container_in_a_store_gives_is_what_the_file_gives(store, network, container_path, images):
    address = put(store, "room.ltc", container_path.read_bytes())
    weights = np.random.default_rng(1).uniform(0, 2, (images.shape[0], 3)).astype(np.float32)
    with ltm.open(address) as far, ltm.open(container_path) as near:
        assert far.path == address and far.shape == near.shape
        assert np.array_equal(far.to_numpy(), near.to_numpy())
        assert np.array_equal(far.relight(weights), near.relight(weights))
        again = pickle.loads(pickle.dumps(far))
        assert np.array_equal(again[3:5, 7], near[3:5, 7])
        again.close()
    assert ltm.info(address) == ltm.info(container_path) | {"path": address}
    assert ltm.verify(address).blocks == ltm.verify(container_path).blocks


def test_only_what_is_wanted_is_fetched(store, network, large):
    address = put(store, "noise.ltc", large.read_bytes())
    size = large.stat().st_size
    with ltm.open(address) as far, ltm.open(large) as near:
        # One request for the length, one for the end of the file.
        assert [asked[0] for asked in network.asked] == ["HEAD", "GET"]
        assert network.bytes <= max(size // 32, 1 << 17)
        before = network.bytes
        assert np.array_equal(far[100, 100], near[100, 100])
        assert network.bytes - before <= 2 << 16, "one block"
        before, requests = network.bytes, len(network.asked)
        assert np.array_equal(far.relight(np.ones((24, 3), np.float32)), near.relight(np.ones((24, 3), np.float32)))
        # Read ahead: not a request for each of 256 blocks, and nothing much twice.
        assert network.bytes - before <= size * 1.2
        assert len(network.asked) - requests < 60


def _one_pixel(m, answers) -> None:
    answers.put(m[1, 2].tolist())


def test_a_forked_process_makes_connections_of_its_own(store, network, container_path):
    address = put(store, "forked.ltc", container_path.read_bytes())
    with ltm.open(address) as m:
        context = multiprocessing.get_context("fork")
        answers = context.Queue()
        process = context.Process(target=_one_pixel, args=(m, answers))
        process.start()
        assert answers.get(timeout=60) == m[1, 2].tolist()
        process.join()


def test_what_is_not_there_or_was_replaced_is_said(store, network, container_path, large):
    with pytest.raises(FileNotFoundError, match="no such bucket or object"):
        ltm.open(f"s3://{BUCKET}/nothing.ltc")
    with pytest.raises(FileNotFoundError, match="no such bucket or object"):
        ltm.open("s3://another/room.ltc")
    with pytest.raises(ValueError, match="is not a container"):
        ltm.open(put(store, "text", b"hello"))
    with pytest.raises(ValueError, match="copy it to a disk"):
        ltm.open(f"s3://{BUCKET}/room.ltm")
    with pytest.raises(ValueError, match="names no object"):
        ltm.open("s3://alone")
    with pytest.raises(ltm.DamagedError, match="cut short"):
        ltm.open(put(store, "cut.ltc", container_path.read_bytes()[:-1]))
    with ltm.open(put(store, "replaced.ltc", large.read_bytes())) as m:
        put(store, "replaced.ltc", large.read_bytes()[::-1])
        with pytest.raises(OSError, match="was replaced while it was read"):
            m.to_numpy()


def test_an_open_network_has_to_be_allowed(network, monkeypatch):
    monkeypatch.delenv("AWS_ALLOW_HTTP")
    with pytest.raises(ValueError, match="AWS_ALLOW_HTTP=true"):
        ltm.open(f"s3://{BUCKET}/room.ltc")


@pytest.mark.parametrize("fault", FAULTS)
def test_a_container_is_read_whole_through_a_bad_network(store, network, large, fault):
    address = put(store, "bad.ltc", large.read_bytes())
    network.faults, network.share = (fault,), 0.3
    with ltm.open(address) as far, ltm.open(large) as near:
        assert np.array_equal(far[::5, ::3, 1], near[::5, ::3, 1])
    assert network.failed >= 2


@pytest.fixture(scope="module")
def room(tmp_path_factory) -> Path:
    """A small room of two ranges, of which the first gives a shard of two parts: noise that is kept does not compress."""
    folder = tmp_path_factory.mktemp("room")
    (folder / "room.obj").write_text(OBJ)
    (folder / "room.mtl").write_text(MTL)
    (folder / "room.toml").write_text(SCENE.format(width=512, height=384, texels=16, samples=2, side=16))
    exact = ["--target", "80dB", "--keep-noise"]
    run(PROGRAM, "plan", folder / "room.toml", "-o", folder / "room.plan.json", "--blocks", 600, *exact)
    run(PROGRAM, "render", folder / "room.toml", "--pack", "-o", folder / "single.ltc", *exact)
    return folder


def names(store: int, prefix: str) -> list[str]:
    page = ask(store, "GET", f"/{BUCKET}?list-type=2&prefix={prefix}/")[2].decode()
    return [part.split("</Key>")[0] for part in page.split("<Key>")[1:]]


@needs_program
@pytest.mark.parametrize("fault", FAULTS)
def test_shards_go_through_a_bad_network(store, network, room, tmp_path, fault):
    plan, address = room / "room.plan.json", f"s3://{BUCKET}/{fault}/shards"
    network.faults, network.share = (fault,), 0.3
    for number in (0, 1):
        run(PROGRAM, "build", "--plan", plan, "--range", number, "--out", address)
    before = len(network.asked)
    assert "there already" in run(PROGRAM, "build", "--plan", plan, "--range", 0, "--out", address).stdout
    assert {asked[0] for asked in network.asked[before:]} == {"GET"}, "one look"
    run(PROGRAM, "build", "--plan", plan, "--range", 1, "--out", address, "--check")
    run(PROGRAM, "merge", "--plan", plan, address, "-o", tmp_path / "room.ltc")
    assert digest(tmp_path / "room.ltc") == digest(room / "single.ltc")
    assert [path.name for path in tmp_path.iterdir()] == ["room.ltc"], "copies of shards are removed"
    assert len(names(store, fault)) == 2 and network.failed >= 2
    parts = [asked for asked in network.asked if "partNumber" in asked[1]]
    assert len(parts) >= 2, "the longer shard has two parts"


@needs_program
def test_shards_of_others_and_damaged_ones_are_refused_by_name(store, network, room, tmp_path):
    plan, address = room / "room.plan.json", f"s3://{BUCKET}/mixed"
    for number in (0, 1):
        run(PROGRAM, "build", "--plan", plan, "--range", number, "--out", address)
    whole = sorted(names(store, "mixed"))
    data = bytearray(ask(store, "GET", f"/{BUCKET}/{whole[1]}")[2])
    put(store, "mixed/" + "0" * 16 + "-renamed.shard", bytes(data))
    put(store, "mixed/" + "1" * 16 + "-text.shard", b"hello")
    data[-1] ^= 1
    put(store, whole[1], bytes(data))
    merge = [PROGRAM, "merge", "--plan", str(plan), address, "-o", str(tmp_path / "room.ltc")]
    done = subprocess.run(merge, capture_output=True, text=True)
    assert (done.returncode, done.stdout.split()) == (8, ["600..768"]), done.stderr
    for name, problem in [("renamed", "was renamed"), ("text", "cut short"), (Path(whole[1]).name, "was changed")]:
        assert any(name in line and problem in line for line in done.stderr.splitlines()), done.stderr
    run(PROGRAM, "build", "--plan", plan, "--range", 1, "--out", address, "--check")
    run(*merge)
    assert digest(tmp_path / "room.ltc") == digest(room / "single.ltc")


@needs_program
def test_the_programs_read_a_container_from_a_store(store, network, large, tmp_path):
    address = put(store, "programs.ltc", large.read_bytes())
    near, far = run(PROGRAM, "info", large).stdout, run(PROGRAM, "info", address).stdout
    assert far == near.replace(str(large), address)
    assert network.bytes < large.stat().st_size / 8
    run(PROGRAM, "relight", large, "-o", tmp_path / "near.png", "--device", "cpu")
    run(PROGRAM, "relight", address, "-o", tmp_path / "far.png", "--device", "cpu")
    assert digest(tmp_path / "far.png") == digest(tmp_path / "near.png")
    assert "sound" in run(PROGRAM, "verify", address).stdout
    unpack = Path(PROGRAM).with_name("ltm-unpack")
    if unpack.exists():
        run(unpack, address, "-o", tmp_path / "far.npy", "--crop", "32,32,16x16")
        run(unpack, large, "-o", tmp_path / "near.npy", "--crop", "32,32,16x16")
        assert digest(tmp_path / "far.npy") == digest(tmp_path / "near.npy")


@needs_program
def test_a_store_that_is_gone_is_one_clear_line(network):
    environment = os.environ | network.environment | {"AWS_ENDPOINT_URL": "http://127.0.0.1:9"}
    begun = time.monotonic()
    done = subprocess.run([PROGRAM, "info", "s3://depot/room.ltc"], capture_output=True, text=True, env=environment)
    assert done.returncode == 5 and time.monotonic() - begun < 90
    assert len(done.stderr.splitlines()) == 1 and "look at the network, AWS_ENDPOINT_URL" in done.stderr, done.stderr
