#!/usr/bin/env python3
"""What a farm of 10 to 10,000 workers would take, from what one machine measured.

    ltm plan scene.toml -o p.json ...                     # measures blocks of the scene as it is
    python3 tools/farm/simulate.py p.json --size 8192x4096 --clean 0.05 --analyse 1.4 --code 0.23 ...

Events are simulated unit by unit, round by round: the scheduler's share of each task, loading the scene, what a unit reads from the depot,
its work, what it leaves there, and workers that are lost with what they had at hand. All units of a round are done before the next begins;
between two rounds one machine reads what all units say of themselves. A plan made of a small picture stands for a large one: costs of a
block are taken in turn from the plan's ranges.
"""

import argparse
import heapq
import json
import random
from dataclasses import dataclass

MEBI = 2**20


def parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plan", help="a plan of ltm plan: what blocks cost, and loading the scene")
    parser.add_argument("--size", default=None, metavar="WxH", help="the picture in pixels [default: the plan's]")
    parser.add_argument("--workers", default="10,100,1000,10000", help="numbers of workers, of one core each")
    parser.add_argument("--unit-seconds", type=float, default=300.0, help="work of a unit [default: 300]")
    work = parser.add_argument_group("seconds of one core")
    work.add_argument("--trace", type=float, help="tracing a block [default: the plan's, range by range]")
    work.add_argument("--trace-setup", type=float, help="before a range is traced [default: the plan's]")
    work.add_argument("--clean", type=float, required=True, help="denoising a block, in a window")
    work.add_argument("--analyse", type=float, required=True, help="analysing a block")
    work.add_argument("--code", type=float, required=True, help="cutting and coding a block")
    work.add_argument("--setup", type=float, default=0.5, help="before a unit of the rounds after the first [default: 0.5]")
    work.add_argument("--join", type=float, default=5.0, help="between two rounds, beside reading [default: 5]")
    bytes_of = parser.add_argument_group("what passes through the depot for a block, in MiB")
    bytes_of.add_argument("--planes", type=float, required=True, help="planes, which cleaning reads of its window and around it")
    bytes_of.add_argument("--tiles", type=float, required=True, help="tiles, which cleaning reads of its window")
    bytes_of.add_argument("--spreading", type=float, required=True, help="what analysing reads beside the images")
    bytes_of.add_argument("--images", type=float, required=True, help="denoised images")
    bytes_of.add_argument("--summary", type=float, default=0.003, help="the summary of an analysed block [default: 0.003]")
    bytes_of.add_argument("--coded", type=float, default=0.005, help="a coded block [default: 0.005]")
    parser.add_argument("--window", type=int, default=256, help="pixels of a window's side [default: 256]")
    parser.add_argument("--halo", type=int, default=160, help="pixels around a window that cleaning reads [default: 160]")
    parser.add_argument("--fit-mib", type=float, default=0.0, help="sums for the fit of columns that a window leaves, in MiB")
    parser.add_argument("--sums-mib", type=float, default=0.0, help="sums over columns that a coded range leaves, in MiB")
    parser.add_argument("--not-kept", type=float, default=0.0, help="of the ranges, those that are coded where they were not analysed [default: 0]")
    parser.add_argument("--depot-gbit", type=float, default=10.0, help="what the depot takes, and what it gives, Gbit/s [default: 10]")
    parser.add_argument("--worker-gbit", type=float, default=1.0, help="the same for each worker, and for who merges [default: 1]")
    parser.add_argument("--slow-share", type=float, default=0.0, help="of a unit's transfers, those that the depot delays [default: 0]")
    parser.add_argument("--slow-seconds", type=float, default=30.0, help="by so much [default: 30]")
    parser.add_argument("--task-milliseconds", type=float, default=1.0, help="of the scheduler for each task [default: 1]")
    parser.add_argument("--lost-per-hour", type=float, default=0.05, help="of a worker, the chance to be lost in an hour [default: 0.05]")
    parser.add_argument("--back-seconds", type=float, default=60.0, help="until another stands in for it [default: 60]")
    return parser.parse_args()


@dataclass
class Unit:
    """Seconds of one core, and bytes from and to the depot."""

    seconds: float
    read: float
    written: float


@dataclass
class Round:
    name: str
    units: list
    #: Bytes that are read at its end by one machine.
    joined: float


class Job:
    """The rounds of the large picture."""

    def __init__(self, plan: dict, asked: argparse.Namespace):
        shape = plan["shape"]
        width, height = (int(side) for side in (asked.size or f"{shape['width']}x{shape['height']}").split("x"))
        side = shape["block_side"]
        self.blocks = -(-width // side) * -(-height // side)
        self.raw_bytes = width * height * 3 * shape["columns"] * 4
        parts = []
        for part in plan["ranges"]:
            first, end = map(int, part["blocks"].split(".."))
            parts.append(part["core_seconds"] / (end - first) if asked.trace is None else asked.trace)
        mean = sum(parts) / len(parts)
        gathered = (asked.planes + asked.tiles + asked.spreading) * MEBI
        setup = plan["estimate"]["setup_seconds"] if asked.trace_setup is None else asked.trace_setup
        self.rounds = []
        traced = self.ranges(mean, asked)
        units = [Unit(setup + n * parts[i % len(parts)], 0.0, n * gathered) for i, n in enumerate(traced)]
        self.rounds.append(Round("trace", units, 20e3 * len(units)))
        across, down = -(-width // asked.window), -(-height // asked.window)
        each = self.blocks / (across * down)
        with_halo = (1 + 2 * asked.halo / asked.window) ** 2
        cleaned = Unit(
            asked.setup + each * asked.clean * (1 + with_halo) / 2,
            each * (asked.planes * min(with_halo, across * down) + asked.tiles) * MEBI,
            (each * asked.images + asked.fit_mib) * MEBI,
        )
        self.rounds.append(Round("clean", [cleaned] * (across * down), asked.fit_mib * MEBI * across * down))
        ranges = self.ranges(asked.analyse, asked)
        read = (asked.spreading + asked.images) * MEBI
        units = [Unit(asked.setup + n * asked.analyse, n * read, n * asked.summary * MEBI) for n in ranges]
        self.rounds.append(Round("analyse", units, self.blocks * asked.summary * MEBI))
        chance = random.Random(2)
        units = []
        for n in ranges:
            again = chance.random() < asked.not_kept
            seconds = asked.setup + n * (asked.code + again * asked.analyse)
            units.append(Unit(seconds, n * read * again, (n * asked.coded + asked.sums_mib) * MEBI))
        self.rounds.append(Round("code", units, self.blocks * asked.coded * MEBI + len(units) * asked.sums_mib * MEBI))
        traced_alone = sum(n * parts[i % len(parts)] for i, n in enumerate(traced))
        self.alone = traced_alone + self.blocks * (asked.clean + asked.analyse + asked.code)

    def ranges(self, seconds: float, asked: argparse.Namespace) -> list:
        """Blocks of each range of about the seconds that were asked for."""
        each = max(round(asked.unit_seconds / seconds), 1)
        return [min(each, self.blocks - first) for first in range(0, self.blocks, each)]


class Farm:
    """Workers, the scheduler and the depot, as time goes on."""

    def __init__(self, workers: int, asked: argparse.Namespace):
        self.asked, self.workers = asked, workers
        self.chance = random.Random(1)
        self.now = self.lost = 0.0
        self.losses = 0

    def transfer(self, queue: float, begin: float, size: float) -> tuple:
        """When the depot is free again, and when the transfer ends: one after the other at the depot's rate, each no faster than its worker."""
        if not size:
            return queue, begin
        queue = max(queue, begin) + size * 8.0 / (self.asked.depot_gbit * 1e9)
        end = max(queue, begin + size * 8.0 / (self.asked.worker_gbit * 1e9))
        slow = self.asked.slow_seconds if self.chance.random() < self.asked.slow_share else 0.0
        return queue, end + slow

    def run(self, todo: list) -> float:
        """Seconds of a round."""
        begun = self.now
        rate = self.asked.lost_per_hour / 3600.0
        todo = todo[::-1]
        # What happens when: a worker is free, or has done the work of a unit.
        events: list = [(begun, worker, None) for worker in range(min(self.workers, 2 * len(todo)))]
        scheduler = gives = takes = end = begun
        while events:
            now, worker, unit = heapq.heappop(events)
            if unit is not None:
                takes, left = self.transfer(takes, now, unit.written)
                end = max(end, left)
                heapq.heappush(events, (left, worker, None))
            elif todo:
                unit = todo.pop()
                # One task after the other leaves the scheduler.
                scheduler = max(scheduler, now) + self.asked.task_milliseconds / 1000.0
                gives, here = self.transfer(gives, scheduler, unit.read)
                until_loss = self.chance.expovariate(rate) if rate > 0 else float("inf")
                if scheduler + until_loss < here + unit.seconds:
                    self.losses += 1
                    self.lost += until_loss
                    todo.append(unit)
                    heapq.heappush(events, (scheduler + until_loss + self.asked.back_seconds, worker, None))
                else:
                    heapq.heappush(events, (here + unit.seconds, worker, unit))
        self.now = end
        return end - begun

    def join(self, size: float) -> float:
        """Seconds between two rounds."""
        rate = min(self.asked.worker_gbit * 10, self.asked.depot_gbit) * 1e9
        seconds = self.asked.join + size * 8.0 / rate
        self.now += seconds
        return seconds


def clock(seconds: float) -> str:
    if seconds >= 2 * 86400:
        return f"{seconds / 86400:.1f} d"
    if seconds >= 2 * 3600:
        return f"{seconds / 3600:.1f} h"
    return f"{seconds / 60:.1f} min" if seconds >= 120 else f"{seconds:.0f} s"


def main() -> None:
    asked = parsed()
    with open(asked.plan) as file:
        job = Job(json.load(file), asked)
    print(f"{job.blocks} blocks, {job.raw_bytes / 2**40:.2f} TiB of matrix; {clock(job.alone)} of one core\n")
    print("| round | units | work of a unit | from the depot | to the depot | read at its end |\n|---|---|---|---|---|---|")
    for part in job.rounds:
        read, written = (sum(getattr(unit, name) for unit in part.units) / 2**30 for name in ("read", "written"))
        longest = clock(max(unit.seconds for unit in part.units))
        print(f"| {part.name} | {len(part.units):,} | {longest} | {read:.1f} GiB | {written:.1f} GiB | {part.joined / 2**30:.2f} GiB |")
    names = " | ".join(part.name for part in job.rounds)
    print(f"\n| workers | {names} | between rounds | merge | whole | efficiency | units lost, work lost |\n|{'---|' * (len(job.rounds) + 6)}")
    for workers in map(int, asked.workers.split(",")):
        farm, took, between = Farm(workers, asked), [], 0.0
        for part in job.rounds:
            took.append(farm.run(part.units))
            seconds = farm.join(part.joined)
            between += seconds
        merge = seconds
        print(
            f"| {workers:,} | {' | '.join(map(clock, took))} | {clock(between - merge)} | {clock(merge)} | {clock(farm.now)} "
            f"| {100 * job.alone / (workers * farm.now):.0f} % | {farm.losses}, {100 * farm.lost / job.alone:.1f} % |"
        )


if __name__ == "__main__":
    main()
