"""A call in a forked process with a session of its own, which dies with all that it has started."""

import contextlib
import os
import signal
import sys
import time
import traceback


class Child:
    """A call of this process's functions in a forked one, with its output in a file."""

    def __init__(self, call, log):
        self.log, self.code = log, None
        sys.stdout.flush()
        self.pid = os.fork()
        if self.pid == 0:
            code = 99
            try:
                os.setsid()
                descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
                os.dup2(descriptor, 1)
                os.dup2(descriptor, 2)
                sys.stdout, sys.stderr = open(1, "w", closefd=False), open(2, "w", closefd=False)  # noqa: SIM115
                code = call()
            except SystemExit as stopped:
                code = stopped.code
            except BaseException:
                traceback.print_exc()
            finally:
                with contextlib.suppress(OSError, ValueError):
                    sys.stdout.flush()
                with contextlib.suppress(OSError, ValueError):
                    sys.stderr.flush()
                os._exit(code if isinstance(code, int) else 98)

    def poll(self):
        """The exit code, None while it runs."""
        if self.code is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                self.code = os.waitstatus_to_exitcode(status)
        return self.code

    returncode = property(poll)

    def wait(self, seconds):
        """Whether it ends within so long."""
        end = time.monotonic() + seconds
        while self.poll() is None and time.monotonic() < end:
            time.sleep(0.01)
        return self.code is not None

    def kill(self):
        """SIGKILL to it and all it has started; whether it still ran."""
        if self.poll() is not None:
            return False
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.pid, signal.SIGKILL)
        os.waitpid(self.pid, 0)
        self.code = -signal.SIGKILL
        return True

    def terminate(self):
        """SIGTERM."""
        os.kill(self.pid, signal.SIGTERM)
