"""The interface of other packages to compiled code: decorators for kernels, and solvers that kernels call.

Kernels:
    kernel: a decorator; the function is compiled for plain arrays and numbers with IEEE arithmetic, and kept on disk
        until one of its sources changes. kernel(nogil=True) releases Python's lock; kernel(short_loops=True)
        compiles faster where no loop is worth being unrolled or vectorised.
    part: a decorator for functions that only kernels call; part(inline=True) where a call costs more than the work.
    standalone: a part that Python can call, for tests.
    machine_code: a kernel for arguments of declared kinds, without numba's look at them. Arguments of a call are not
        checked, so bind it where they are made.
    entry_address: address of the machine code of a kernel, for call_range.
    cache_directory: folder of the compiled kernels, named after their sources.
Arrays in kernels:
    borrow: arrays, and NamedTuples of them, without reference counts. Their owner must outlive the borrowed ones:
        borrow from arguments, not from arrays that the same function makes.
    carve: an array of a shape from one-dimensional borrowed memory.
    singles_at: an array of a shape of float32 at an address, which a call takes in less time than an array.
    next_uniform: the next number of a NumPy bit generator.
Arrays that stay where they are:
    Floats, Singles, Integers: for declarations, `field: Annotated[Floats, "B", 3]` in a NamedTuple; its other fields
        are float, int, bool, or such NamedTuples.
    Pinned: the addresses of a NamedTuple's arrays, and its numbers as they are now; it keeps the arrays alive.
    unpin: in a kernel, the NamedTuple from `Pinned.address`. Another layout raises WrongLayout.
Motors and sheaths, parts of kernels; the formulas of `rollingjoint.transmission`:
    play_step, play_contact, play_place, play_inverse: the play between a motor and its tendon.
    sheath_direction, sheath_ratio: the friction of a sheath.
    limited_tension, at_limit: the limits of tension of a motor.
    pull_limit, pull_end: a motor with a limit of the tension before its sheath.
    FREE: how near to its command a tendon is at no limit [mm]. NARROW: half the width of a play that is none [mm].
    unstretched_length, motor_yield, paid_out: positions of a tendon and its motor after a limit.
Solvers:
    BatchArrays: inputs and results of a batch of rolling chains; of any class of chains, its kernels.batch_arrays.
        PinnedRange solves ranges of its rows, step_range with friction.
    call_range: in a kernel, call_range(entry, pins, PinnedBatch, first, last) with entry and pins of a
        PinnedRange (arms: PinnedHinges, rolling joints in space: PinnedContacts); number of rows left to its
        solve_the_rest, -1 where it had no memory. TendonLaw: commanded lengths, stiffnesses and tension
        limits, (B, m) each. PENDING: the status of a row left to it. WIDTH: rows that are solved side by side.
    FrictionArrays: friction of rows, with histories, for step_range, and for begin_range, which fills histories before
        any slip. A caller copies `after` to `before` where a step stands. MU, PRESLIDING, CONSTANT: some of its
        N_COEFFICIENTS columns.
    new_friction_arrays: FrictionArrays of a FrictionLaw and a History.
    run_in_threads: work on ranges of rows, on the threads of this process. runs_at_once: True where it does a single
        row on the caller's thread.

ROLLINGJOINT_CHECK_BOUNDS=1 in the environment has every index of kernels checked, and the arguments of machine code.
"""

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.cache import cache_directory
from rollingjoint._numba.jit import entry_address, kernel, machine_code, part, standalone
from rollingjoint._numba.layout import Floats, Integers, Singles
from rollingjoint._numba.pins import Pinned, WrongLayout, call_range, next_uniform, unpin
from rollingjoint._numba.simd import WIDTH
from rollingjoint._numba.views import carve, singles_at
from rollingjoint.chain.batch import PinnedRange, begin_range, step_range
from rollingjoint.kernels.arrays import TendonLaw
from rollingjoint.kernels.contacts import PinnedContacts
from rollingjoint.kernels.friction import (
    CONSTANT,
    MU,
    N_COEFFICIENTS,
    PRESLIDING,
    FrictionArrays,
    FrictionLaw,
    History,
    new_friction_arrays,
)
from rollingjoint.kernels.hinges import PinnedHinges
from rollingjoint.kernels.lanes import PENDING
from rollingjoint.kernels.rolling import BatchArrays, PinnedBatch
from rollingjoint.threads import run_in_threads, runs_at_once
from rollingjoint.transmission.kernels import (
    FREE,
    NARROW,
    at_limit,
    limited_tension,
    motor_yield,
    paid_out,
    play_contact,
    play_inverse,
    play_place,
    play_step,
    pull_end,
    pull_limit,
    sheath_direction,
    sheath_ratio,
    unstretched_length,
)

__all__ = [
    "CONSTANT",
    "FREE",
    "MU",
    "NARROW",
    "N_COEFFICIENTS",
    "PENDING",
    "PRESLIDING",
    "WIDTH",
    "BatchArrays",
    "Floats",
    "FrictionArrays",
    "FrictionLaw",
    "History",
    "Integers",
    "Pinned",
    "PinnedBatch",
    "PinnedContacts",
    "PinnedHinges",
    "PinnedRange",
    "Singles",
    "TendonLaw",
    "WrongLayout",
    "at_limit",
    "begin_range",
    "borrow",
    "cache_directory",
    "call_range",
    "carve",
    "entry_address",
    "kernel",
    "limited_tension",
    "machine_code",
    "motor_yield",
    "new_friction_arrays",
    "next_uniform",
    "paid_out",
    "part",
    "play_contact",
    "play_inverse",
    "play_place",
    "play_step",
    "pull_end",
    "pull_limit",
    "run_in_threads",
    "runs_at_once",
    "sheath_direction",
    "sheath_ratio",
    "singles_at",
    "standalone",
    "step_range",
    "unpin",
    "unstretched_length",
]
