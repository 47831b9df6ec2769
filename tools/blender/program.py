# SPDX-License-Identifier: GPL-3.0-or-later
"""The program ltm: where it is, and a run of it that can be watched and stopped."""

import os
import re
import shutil
import signal
import subprocess
import threading
from pathlib import Path

PROGRESS = re.compile(r"progress: (.*) (\d+)/(\d+)$")
# Seconds that a program has to end after it was asked to.
PATIENCE = 10.0


def beside(program, name):
    """Another of the programs, that lies in the folder of the one that was found, or else on the path. None where there is none."""
    place = Path(program).with_name(name + Path(program).suffix)
    return str(place) if place.is_file() else shutil.which(name)


def find(stated=""):
    """The program: as it is stated in the preferences or in LTM, on the path, or where cargo installs. None where there is none."""
    name = "ltm.exe" if os.name == "nt" else "ltm"
    stated = stated or os.environ.get("LTM", "")
    if stated:
        return stated if Path(stated).is_file() else None
    home = Path.home() / ".cargo" / "bin" / name
    return shutil.which(name) or (str(home) if home.is_file() else None)


class Run:
    """A run of a program, of ltm or another Blender. Threads read what it says, so that nothing waits for it.

    `asks`: it is asked to end, and then leaves its files in order; else it is ended, as its files are thrown away.
    """

    def __init__(self, arguments, asks=True):
        self.asks = asks
        self.stage, self.done, self.total = "starting", 0, 0
        self.lines, self.stopped = [], False
        # A group of its own, so that Ctrl-C in Blender's terminal is Blender's.
        apart = {"creationflags": subprocess.CREATE_NO_WINDOW} if os.name == "nt" else {"start_new_session": True}
        pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        text = {"text": True, "encoding": "utf-8", "errors": "replace"}
        self.process = subprocess.Popen([str(a) for a in arguments], **pipes, **text, **apart)
        streams = (self.process.stdout, self.process.stderr)
        self.threads = [threading.Thread(target=self._read, args=(stream,), daemon=True) for stream in streams]
        for thread in self.threads:
            thread.start()

    def _read(self, stream):
        for line in stream:
            line = line.rstrip("\n")
            found = PROGRESS.match(line)
            if found:
                self.stage, self.done, self.total = found[1], int(found[2]), int(found[3])
            elif line:
                self.lines.append(line)

    def is_running(self):
        return self.process.poll() is None

    def share(self):
        """How much of the stage is done, 0 to 1."""
        return min(1.0, self.done / self.total) if self.total else 0.0

    def status(self):
        """What it does, for the status bar."""
        return f"ltm: {self.stage}, {100 * self.share():.0f} %" if self.total else f"ltm: {self.stage}"

    def wait(self):
        """Waits for its end and returns its exit code."""
        code = self.process.wait()
        for thread in self.threads:
            thread.join()
        return code

    def stop(self):
        """Ends it."""
        self.stopped = True
        if not self.is_running():
            return
        if not self.asks:
            self.process.kill()
        elif os.name == "nt":
            self.process.terminate()
        else:
            self.process.send_signal(signal.SIGINT)
        try:
            self.process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self.process.kill()

    def problem(self):
        """Its error, the last line that it said so in, for a report."""
        said = [line for line in self.lines if line.startswith("ltm")]
        return (said or self.lines or ["ltm ended without a word"])[-1]


class Chain:
    """Runs of programs, one after the other as long as they succeed, as if they were one."""

    def __init__(self, *steps):
        """Each step is arguments, and whether the program is asked to end where it is to."""
        self.waiting, self.lines_before = list(steps), []
        self.run = Run(*self.waiting.pop(0))

    def is_running(self):
        if self.run.is_running():
            return True
        if self.run.stopped or not self.waiting or self.run.wait() != 0:
            return False
        self.lines_before += self.run.lines
        self.run = Run(*self.waiting.pop(0))
        return True

    def wait(self):
        """Waits for the end of all and returns the exit code of the last that ran."""
        while self.is_running():
            self.run.wait()
        return self.run.wait()

    @property
    def lines(self):
        return self.lines_before + self.run.lines

    @property
    def stopped(self):
        return self.run.stopped

    def share(self):
        return self.run.share()

    def status(self):
        return self.run.status()

    def stop(self):
        self.run.stop()

    def problem(self):
        return self.run.problem()
