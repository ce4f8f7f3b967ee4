"""A Dask cluster on this machine, by the two commands that start one anywhere."""

import contextlib
import os
import signal
import subprocess
import sys


class Cluster:
    """A scheduler and workers, each a process in a session of its own."""

    def __init__(self, folder):
        self.folder, self.processes = folder, []
        self.file = folder / "scheduler.json"
        self.start("scheduler", "--port", "0", "--dashboard-address", ":0", "--scheduler-file",
                   self.file)  # fmt: skip
        self.workers = [self.worker(), self.worker()]

    def start(self, *words):
        path = os.pathsep.join(sys.path)
        with (self.folder / "log").open("ab") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", "dask", *map(str, words)], stdout=log, stderr=log,
                start_new_session=True, env=os.environ | {"PYTHONPATH": path},
            )  # fmt: skip
        self.processes.append(process)
        return process

    def worker(self):
        return self.start(
            "worker", "--scheduler-file", self.file, "--nthreads", "1", "--no-dashboard",
            "--local-directory", self.folder / "space",
        )  # fmt: skip

    def end(self):
        for process in self.processes:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
