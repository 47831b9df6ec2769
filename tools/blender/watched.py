# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators that run programs: to the end where there is no window, else beside it, with progress, until Esc."""

import bpy

from . import program
from .finding import open_mixer


class Watched:
    """What such operators have in common. `start` sets `run` and says whether it runs; `finish` reports how it ended."""

    run = None
    timer = None

    def begin(self, arguments):
        """Starts a program; whether it runs, with an error reported where it does not."""
        try:
            self.run = program.Run(arguments)
        except OSError as error:
            self.report({"ERROR"}, f"{arguments[0]} does not start: {error.strerror}")
            return False
        return True

    def succeeded(self):
        """Reports what the run warned of, and what it failed of; whether it ended well."""
        code = self.run.wait()
        for line in self.run.lines:
            if line.startswith("warning: "):
                self.report({"WARNING"}, line.removeprefix("warning: "))
        if self.run.stopped:
            self.report({"WARNING"}, "the render was cancelled")
        elif code != 0:
            self.report({"ERROR"}, self.run.problem())
        return code == 0 and not self.run.stopped

    def show(self, context):
        """Opens the mixer, where one is wanted."""
        if self.open_mixer and not bpy.app.background:
            open_mixer(self, context, self.packed)

    def execute(self, context):
        """Without a window: to the end, in one go."""
        return self.finish(context) if self.start(context) else {"CANCELLED"}

    def invoke(self, context, _event):
        if not self.start(context):
            return {"CANCELLED"}
        self.timer = context.window_manager.event_timer_add(0.1, window=context.window)
        context.window_manager.progress_begin(0, 100)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type == "ESC" and event.value == "PRESS":
            self.run.stop()
        if self.run.is_running():
            context.workspace.status_text_set(f"{self.run.status()} – Esc cancels")
            context.window_manager.progress_update(100 * self.run.share())
            return {"PASS_THROUGH"}
        self.tidy(context)
        return self.finish(context)

    def cancel(self, context):
        """Blender ends or opens another file."""
        self.run.stop()
        self.tidy(context)

    def tidy(self, context):
        context.window_manager.event_timer_remove(self.timer)
        context.window_manager.progress_end()
        context.workspace.status_text_set(None)
