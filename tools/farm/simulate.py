#!/usr/bin/env python3
"""What a farm of 10 to 10,000 workers would take, from what one machine measured.

    ltm plan scene.toml -o p.json ...                     # measures blocks of the scene as it is
    python3 tools/farm/simulate.py p.json --size 8192x4096 --merge-block-seconds 0.4

Events are simulated range by range: loading the scene, building, the shared way into the depot, workers that are lost with what they
had at hand, and the scheduler's share of each task. The merge follows when the last range is there. A plan made of a small picture
stands for a large one: costs of a block are taken in turn from the plan's ranges.
"""

import argparse
import heapq
import json
import random


def parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plan", help="a plan of ltm plan: what blocks cost, and loading the scene")
    parser.add_argument("--size", default=None, metavar="WxH", help="the picture in pixels [default: the plan's]")
    parser.add_argument("--samples-factor", type=float, default=1.0, help="times the samples of the plan [default: 1]")
    parser.add_argument("--block-seconds", type=float, help="seconds of one core for a block [default: the plan's, range by range]")
    parser.add_argument("--setup-seconds", type=float, help="seconds before each range [default: the plan's]")
    parser.add_argument("--workers", default="10,100,1000,10000", help="numbers of workers, of one core each")
    parser.add_argument("--range-seconds", type=float, default=300.0, help="work of a range [default: 300]")
    parser.add_argument("--merge-block-seconds", type=float, required=True, help="seconds of one core that merging takes for a block")
    parser.add_argument("--merge-cores", type=int, default=2, help="cores of who merges [default: 2]")
    parser.add_argument("--depot-gbit", type=float, default=10.0, help="what the depot takes and gives, Gbit/s [default: 10]")
    parser.add_argument("--task-milliseconds", type=float, default=1.0, help="of the scheduler for each task [default: 1]")
    parser.add_argument("--lost-per-hour", type=float, default=0.05, help="of a worker, the chance to be lost in an hour [default: 0.05]")
    parser.add_argument("--back-seconds", type=float, default=60.0, help="until another stands in for it [default: 60]")
    return parser.parse_args()


class Costs:
    """Blocks of the large picture, by the ranges of a plan."""

    def __init__(self, plan: dict, asked: argparse.Namespace):
        shape = plan["shape"]
        width, height = (int(side) for side in (asked.size or f"{shape['width']}x{shape['height']}").split("x"))
        side = shape["block_side"]
        self.blocks = -(-width // side) * -(-height // side)
        self.raw_bytes = width * height * 3 * shape["columns"] * 4
        self.setup = plan["estimate"]["setup_seconds"] if asked.setup_seconds is None else asked.setup_seconds
        self.each = []
        for part in plan["ranges"]:
            first, end = map(int, part["blocks"].split(".."))
            seconds = part["core_seconds"] / (end - first) if asked.block_seconds is None else asked.block_seconds
            self.each.append((seconds * asked.samples_factor, part["bytes"] / (end - first)))
        seconds = sum(cost for cost, _ in self.each) / len(self.each)
        self.of_range = max(round(asked.range_seconds / seconds), 1)
        self.ranges = -(-self.blocks // self.of_range)

    def of(self, number: int) -> tuple:
        """Seconds and bytes of a range: neighbours cost alike, so a range is of one kind."""
        count = min(self.of_range, self.blocks - number * self.of_range)
        seconds, size = self.each[number % len(self.each)]
        return count * seconds, count * size


def simulate(costs: Costs, workers: int, asked: argparse.Namespace) -> dict:
    """Seconds until the last range is in the depot; bytes; seconds of work lost."""
    chance = random.Random(1)
    rate = asked.lost_per_hour / 3600.0
    depot_seconds_per_byte = 8.0 / (asked.depot_gbit * 1e9)
    todo = list(range(costs.ranges))[::-1]
    free = [(0.0, worker) for worker in range(min(workers, costs.ranges * 2))]
    heapq.heapify(free)
    scheduler = depot = end = lost = total_bytes = 0.0
    losses = 0
    while todo:
        number = todo.pop()
        now, worker = heapq.heappop(free)
        # One task after the other leaves the scheduler.
        scheduler = max(scheduler, now) + asked.task_milliseconds / 1000.0
        seconds, size = costs.of(number)
        seconds += costs.setup
        until_loss = chance.expovariate(rate) if rate > 0 else float("inf")
        if until_loss < seconds:
            losses += 1
            lost += until_loss
            todo.append(number)
            heapq.heappush(free, (scheduler + until_loss + asked.back_seconds, worker))
            continue
        # One after the other into the depot, at its whole rate.
        depot = max(depot, scheduler + seconds) + size * depot_seconds_per_byte
        total_bytes += size
        end = max(end, depot)
        heapq.heappush(free, (depot, worker))
    read = total_bytes * depot_seconds_per_byte
    merge = read + costs.blocks * asked.merge_block_seconds / asked.merge_cores
    return {"build": end, "merge": merge, "bytes": total_bytes, "lost": lost, "losses": losses}


def clock(seconds: float) -> str:
    if seconds >= 2 * 86400:
        return f"{seconds / 86400:.1f} d"
    if seconds >= 2 * 3600:
        return f"{seconds / 3600:.1f} h"
    return f"{seconds / 60:.1f} min" if seconds >= 120 else f"{seconds:.0f} s"


def main() -> None:
    asked = parsed()
    with open(asked.plan) as file:
        costs = Costs(json.load(file), asked)
    work = sum(costs.of(number)[0] for number in range(costs.ranges))
    print(
        f"{costs.blocks} blocks in {costs.ranges} ranges of {costs.of_range}, {costs.raw_bytes / 2**40:.2f} TiB of matrix; "
        f"{clock(work)} of one core, and {costs.setup:.1f} s before each range\n"
    )
    print("| workers | built after | speed-up | to the depot | ranges lost, work lost | merge | whole |\n|---|---|---|---|---|---|---|")
    for workers in map(int, asked.workers.split(",")):
        found = simulate(costs, workers, asked)
        print(
            f"| {workers:,} | {clock(found['build'])} | {work / found['build']:.0f}× | {found['bytes'] / 2**30:.1f} GiB "
            f"| {found['losses']}, {100 * found['lost'] / work:.1f} % | {clock(found['merge'])} | {clock(found['build'] + found['merge'])} |"
        )


if __name__ == "__main__":
    main()
