"""Square roots with the same bits on Intel and AMD processors."""

from torch import Tensor


def square_root(x: Tensor) -> Tensor:
    """Return the square root of each element, of the shape and type of `x`.

    torch.sqrt calls MKL, which starts from the processor's RSQRTPS: its last bits are each maker's own. Here are a root
    and a quotient of torch's own, which IEEE 754 defines to the last bit.
    """
    return x.rsqrt().reciprocal()
