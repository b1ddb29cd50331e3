"""A context in which host and device exchange nothing: every look at a number on the device fails, and every copy."""

from contextlib import contextmanager

from torch.utils._python_dispatch import TorchDispatchMode

READS = ("aten._local_scalar_dense", "aten.nonzero", "aten.masked_select", "aten.equal")
COPIES = ("aten.lift_fresh",)  # of torch.tensor, for which the host waits, too


class _NoHostReads(TorchDispatchMode):
    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        assert not str(func).startswith((*READS, *COPIES)), f"{func} makes the host wait for the device"
        if str(func).startswith(("aten.index.", "aten.index_put")):
            masks = [index for index in args[1] if index is not None and str(index.dtype) == "torch.bool"]
            assert not masks, f"{func} by a mask makes the host wait for the device"
        return func(*args, **(kwargs or {}))


@contextmanager
def no_host_reads():
    """Fails at operations whose result, or whose size, the host has to read from the device, and at copies to it."""
    with _NoHostReads():
        yield
