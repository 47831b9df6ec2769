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


def find(stated=""):
    """The program: as it is stated in the preferences or in LTM, on the path, or where cargo installs. None where there is none."""
    name = "ltm.exe" if os.name == "nt" else "ltm"
    stated = stated or os.environ.get("LTM", "")
    if stated:
        return stated if Path(stated).is_file() else None
    home = Path.home() / ".cargo" / "bin" / name
    return shutil.which(name) or (str(home) if home.is_file() else None)


class Run:
    """A run of ltm. Threads read what it says, so that nothing waits for it."""

    def __init__(self, arguments):
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
        """Ends it: by asking first, so that it leaves its files in order."""
        self.stopped = True
        if not self.is_running():
            return
        if os.name == "nt":
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
