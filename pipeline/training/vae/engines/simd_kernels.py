"""Kernels that train 8 or 16 models at once, one per SIMD lane of a float32 vector, compiled by Numba.

Every array ends in an axis of `LANES`: entry [..., lane] belongs to model `lane`. No operation mixes lanes, so a
model's bits do not depend on its neighbours, its position or the number of lanes. Convolutions and dense layers are
strided matrix products: sums of outer products on a `Tile` of vectors in registers (`_block`).

Numba invalidates a cached function only when its own file changes: all compiled code has to be in this file.
"""

# pyright: reportCallIssue=false, reportAttributeAccessIssue=false
# An intrinsic's first argument is Numba's own; so are the names in its configuration.

import inspect
import os
from tempfile import TemporaryDirectory

import numpy as np
from llvmlite import ir
from llvmlite.binding import get_host_cpu_features, get_host_cpu_name
from numba import config, njit, types
from numba.core import cgutils
from numba.extending import intrinsic, models, register_model


def lanes_of(features: frozenset[str], processor: str) -> int:
    """Return the number of float32 lanes of the processor's widest vectors that run at full speed."""
    return 16 if "avx512vl" in features and processor != "znver4" else 8  # which halves each 512-bit instruction


# Numba compiles for NUMBA_CPU_FEATURES, else for the host's features; its cache is keyed by them.
FLAGS = get_host_cpu_features().flatten() if config.CPU_FEATURES is None else config.CPU_FEATURES
FEATURES = frozenset(flag[1:] for flag in FLAGS.split(",") if flag.startswith("+"))
LANES = lanes_of(FEATURES, config.CPU_NAME or get_host_cpu_name())
VECTOR = ir.VectorType(ir.FloatType(), LANES)
BYTES = ir.IntType(8).as_pointer()
INTEGERS = ir.VectorType(ir.IntType(32), LANES)
PUT, ADD, RELU, GATE = range(4)  # operations on a product: see `_put` and the functions after it
TALL = 5 if "avx512vl" in FEATURES else 2  # rows of a tile: as many as fit in 32 registers, or in 16

OFFSETS = types.intp[::1]
FLAT, MATRIX, ROWS = types.float32[::1], types.float32[:, ::1], types.float32[:, :, ::1]
PLANES, KERNEL, IMAGE = types.float32[:, :, :, ::1], types.float32[:, :, :, :, ::1], types.uint8[:, :, :, ::1]


def compiled(*arguments, returns=types.void):
    """Compile for these types on import, unless cached, so that importing modules are ready to run."""
    return _bare(njit(returns(*arguments), cache=True, error_model="numpy"))


def _bare(decorator):
    """Apply `decorator` to the function without the argument checks that tests wrap it in."""
    return lambda function: decorator(inspect.unwrap(function))


def _cache() -> TemporaryDirectory | None:
    """Let this process and its children cache in a folder of their own if they can write neither here nor at home."""
    try:
        _bare(njit(cache=True))(lanes_of)
    except RuntimeError:
        folder = TemporaryDirectory()
        os.environ["NUMBA_CACHE_DIR"] = config.CACHE_DIR = folder.name
        return folder  # removed with the process


_FOLDER = _cache()


inlined = _bare(njit(forceinline=True, error_model="numpy"))


class Tile(types.Type):
    """rows x columns vectors in registers, used as a local variable of compiled functions."""

    def __init__(self, rows: int, columns: int):
        self.rows, self.columns = rows, columns
        super().__init__(f"Tile({rows}, {columns})")


@register_model(Tile)
class _TileModel(models.PrimitiveModel):
    def __init__(self, manager, tile):
        super().__init__(manager, tile, ir.ArrayType(VECTOR, tile.rows * tile.columns))


def _pointer(context, builder, kind, array, index):
    """Return the address of the index-th vector of a contiguous array."""
    data = context.make_array(kind)(context, builder, array).data
    return builder.gep(builder.bitcast(data, VECTOR.as_pointer()), [index])


def _load(builder, pointer):
    vector = builder.load(pointer)
    vector.align = 4
    return vector


def _vectors(context, builder, kind, array, index, stride, count):
    """Return the vectors index, index + stride, ... of an array; multiples of the stride stay in registers."""
    first = builder.bitcast(_pointer(context, builder, kind, array, index), BYTES)
    stride = builder.mul(stride, ir.Constant(stride.type, 4 * LANES))
    places = [builder.gep(first, [builder.mul(stride, ir.Constant(stride.type, i))]) for i in range(count)]
    return [_load(builder, builder.bitcast(place, VECTOR.as_pointer())) for place in places]


def _call(builder, name, *arguments):
    """Call LLVM's intrinsic `name` on vectors."""
    kind = ir.FunctionType(VECTOR, [VECTOR] * len(arguments))
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{LANES}f32"), arguments)


def _each(builder, tile, function):
    """Return the tile with entries function(row, column) -> vector."""
    value = ir.Constant(ir.ArrayType(VECTOR, tile.rows * tile.columns), ir.Undefined)
    for i in range(tile.rows * tile.columns):
        value = builder.insert_value(value, function(*divmod(i, tile.columns)), i)
    return value


@intrinsic(prefer_literal=True)
def zeros(typingctx, rows, columns):
    """Return a tile of zeros."""
    tile = Tile(rows.literal_value, columns.literal_value)
    return tile(rows, columns), lambda context, builder, sig, args: ir.Constant(context.get_value_type(tile), None)


@intrinsic
def repeat(typingctx, tile, array, index, step):
    """Return the tile whose rows all equal array[index + step * column]."""

    def generate(context, builder, sig, args):
        row = _vectors(context, builder, array, *args[1:], tile.columns)
        return _each(builder, tile, lambda r, c: row[c])

    return tile(tile, array, types.intp, types.intp), generate


@intrinsic
def outer(typingctx, tile, left, i, i_step, right, j, j_step):
    """Return tile[row, column] + left[i + i_step * row] * right[j + j_step * column], rounded once."""

    def generate(context, builder, sig, args):
        a = _vectors(context, builder, left, *args[1:4], tile.rows)
        b = _vectors(context, builder, right, *args[4:7], tile.columns)

        def entry(r, c):
            return _call(builder, "fma", a[r], b[c], builder.extract_value(args[0], r * tile.columns + c))

        return _each(builder, tile, entry)

    return tile(tile, left, types.intp, types.intp, right, types.intp, types.intp), generate


def _writer(combine):
    """Return an intrinsic that sets array[index + row_step * row + column] to combine(builder, tile, its value)."""

    @intrinsic
    def write(typingctx, tile, array, index, row_step):
        def generate(context, builder, sig, args):
            value, data, place, stride = args
            for i in range(tile.rows * tile.columns):
                at = builder.add(place, ir.Constant(place.type, i % tile.columns))
                pointer = _pointer(context, builder, array, data, at)
                new = builder.extract_value(value, i)
                builder.store(combine(builder, new, _load(builder, pointer)), pointer).align = 4
                if (i + 1) % tile.columns == 0:
                    place = builder.add(place, stride)
            return context.get_dummy_value()

        return types.void(tile, array, types.intp, types.intp), generate

    return write


def _rectified(builder, sign, vector):
    """Return `vector` where `sign` is positive, else 0; NaN passes through."""
    zero = ir.Constant(VECTOR, None)
    return builder.select(builder.fcmp_ordered("<=", sign, zero), zero, vector)


_put = _writer(lambda builder, new, old: new)
_add = _writer(lambda builder, new, old: builder.fadd(old, new))
_relu = _writer(lambda builder, new, old: _rectified(builder, new, new))
_gate = _writer(lambda builder, new, old: _rectified(builder, old, new))


def _sigmoid(builder, x):
    """Return 1 / (1 + exp(-x)) by Cephes' polynomial for exp, to 3 units in the last place; constant beyond +-87."""

    def constant(value):
        return ir.Constant(VECTOR, [value] * LANES)

    x = builder.select(builder.fcmp_ordered(">", x, constant(87.0)), constant(87.0), x)  # NaN passes through
    x = builder.fneg(builder.select(builder.fcmp_ordered("<", x, constant(-87.0)), constant(-87.0), x))
    power = _call(builder, "rint", builder.fmul(x, constant(1.44269504)))  # exp(x) = 2**power * exp(rest)
    rest = _call(builder, "fma", power, constant(-0.693359375), x)
    rest = _call(builder, "fma", power, constant(2.12194440e-4), rest)
    series = constant(1.9875691500e-4)
    for coefficient in (1.3981999507e-3, 8.3334519073e-3, 4.1665795894e-2, 1.6666665459e-1, 5.0000001201e-1, 1.0, 1.0):
        series = _call(builder, "fma", series, rest, constant(coefficient))
    exponent = builder.add(builder.fptosi(power, INTEGERS), ir.Constant(INTEGERS, [127] * LANES))
    scale = builder.bitcast(builder.shl(exponent, ir.Constant(INTEGERS, [23] * LANES)), VECTOR)
    return builder.fdiv(constant(1.0), _call(builder, "fma", series, scale, constant(1.0)))


@intrinsic
def _squared_error(typingctx, total, logits, images, index, scale):
    """Return total + d**2 with d = sigmoid(logits[index]) - images[index]; scale * d(d**2)/2 overwrites the logits."""

    def generate(context, builder, sig, args):
        pointer = _pointer(context, builder, logits, args[1], args[3])
        image = _load(builder, _pointer(context, builder, images, args[2], args[3]))
        factor = ir.Constant(VECTOR, ir.Undefined)
        for lane in range(LANES):
            factor = builder.insert_element(factor, args[4], ir.Constant(ir.IntType(32), lane))
        p = _sigmoid(builder, _load(builder, pointer))
        error = builder.fsub(p, image)
        slope = builder.fmul(p, builder.fsub(ir.Constant(VECTOR, [1.0] * LANES), p))
        builder.store(builder.fmul(builder.fmul(factor, error), slope), pointer).align = 4
        before = builder.extract_value(args[0], 0)
        return _each(builder, total, lambda r, c: _call(builder, "fma", error, error, before))

    return total(total, logits, images, types.intp, types.float32), generate


@inlined
def _block(tile, out, a, b, bias, steps, mode):
    """Compute one tile of `product`."""
    tile = repeat(tile, *bias)
    a_steps, b_steps = steps
    k = np.uint64(0)
    while a_steps[k] >= 0:
        tile = outer(tile, a[0], a[1] + a_steps[k], a[2], b[0], b[1] + b_steps[k], b[2])
        k += np.uint64(1)
    if mode == PUT:
        _put(tile, *out)
    elif mode == ADD:
        _add(tile, *out)
    elif mode == RELU:
        _relu(tile, *out)
    else:
        _gate(tile, *out)


@inlined
def _strip(tall, single, rows, out, a, b, bias, steps, mode):
    """Compute all rows of `product` in the columns of the tiles, the last ones each by its own."""
    row = 0
    while row < rows:
        here, left = (out[0], out[1] + row * out[2], out[2]), (a[0], a[1] + row * a[2], a[2])
        if rows - row >= TALL:
            _block(tall, here, left, b, bias, steps, mode)
            row += TALL
        else:
            _block(single, here, left, b, bias, steps, mode)
            row += 1


OPERAND = types.Tuple((FLAT, types.intp, types.intp))


@compiled(*[types.intp] * 2, *[OPERAND] * 4, types.UniTuple(OFFSETS, 2), types.intp)
def product(rows, columns, out, a, b, bias, steps, mode):
    """Compute out[row, column] = bias[column] + sum over k of a[row, k] * b[k, column], modified by `mode`.

    Operands: (flat array, first vector, stride [vectors] of the rows of out and a, of the columns of b and bias).
    `steps`: offsets [vectors] of each k in a and b; a negative offset in a ends the list.
    """
    column = 0
    while column < columns:
        here = out[0], out[1] + column, out[2]
        right = b[0], b[1] + column * b[2], b[2]
        start = bias[0], bias[1] + column * bias[2], bias[2]
        if columns - column >= 4:
            _strip(zeros(TALL, 4), zeros(1, 4), rows, here, a, right, start, steps, mode)
            column += 4
        elif columns - column == 3:
            _strip(zeros(TALL, 3), zeros(1, 3), rows, here, a, right, start, steps, mode)
            column += 3
        else:
            _strip(zeros(TALL, 1), zeros(1, 1), rows, here, a, right, start, steps, mode)
            column += 1


@compiled(*[types.UniTuple(types.intp, 3)] * 3, returns=types.UniTuple(OFFSETS, 2))
def _sum(counts, a_strides, b_strides):
    """Return the offsets in a (none negative) and in b visited by three nested loops, outermost first."""
    size = counts[0] * counts[1] * counts[2]
    a_steps = np.full(size + 1, -1)
    b_steps = np.empty_like(a_steps)
    for step in range(size):
        i, j, k = step // (counts[1] * counts[2]), step // counts[2] % counts[1], step % counts[2]
        a_steps[step] = i * a_strides[0] + j * a_strides[1] + k * a_strides[2]
        b_steps[step] = i * b_strides[0] + j * b_strides[1] + k * b_strides[2]
    return a_steps, b_steps


@compiled(PLANES, KERNEL, MATRIX, PLANES, types.intp)
def gather(big, weights, bias, small, mode):
    """Compute a stride-2 3x3 convolution from planes `big` to planes `small`, or the gradient of `scatter`.

    Planes: (1 + row + 1, 1 + column + 1, channel, lane), their border zero. Weights: (3, 3, big channel, small channel,
    lane). Bias: (small channel, lane), or one vector for all.
    """
    _, width, wide, _ = big.shape
    height, across, narrow, _ = small.shape
    x, w, c, y = big.reshape(-1), weights.reshape(-1), bias.reshape(-1), small.reshape(-1)
    steps = _sum((1, 3, 3 * wide), (0, width * wide, 1), (0, 3 * wide * narrow, narrow))
    for row in range(height - 2):
        out, a = (y, ((row + 1) * across + 1) * narrow, narrow), (x, 2 * row * width * wide, 2 * wide)
        product(across - 2, narrow, out, a, (w, 0, 1), (c, 0, len(bias) > 1), steps, mode)


@compiled(PLANES, KERNEL, MATRIX, PLANES, types.intp)
def scatter(small, weights, bias, big, mode):
    """Compute the transposed convolution from planes `small` to `big`, or the gradient of `gather`; same arrays.

    An even row of `big` depends on one row of `small`, an odd one on two; columns likewise.
    """
    height, width, wide, _ = big.shape
    _, across, narrow, _ = small.shape
    x, w, c, y = small.reshape(-1), weights.reshape(-1), bias.reshape(-1), big.reshape(-1)
    tap = wide * narrow
    a_strides, b_strides = (across * narrow, narrow, 1), (-6 * tap, -2 * tap, 1)
    steps = (
        (_sum((1, 1, narrow), a_strides, b_strides), _sum((1, 2, narrow), a_strides, b_strides)),
        (_sum((2, 1, narrow), a_strides, b_strides), _sum((2, 2, narrow), a_strides, b_strides)),
    )  # [odd row][odd column]
    for row in range(height - 2):
        odd = row % 2
        a = (x, ((row // 2 + 1) * across + 1) * narrow, narrow)
        for odd_column in range(2):
            out = (y, ((row + 1) * width + 1 + odd_column) * wide, 2 * wide)
            b = (w, (1 + odd) * 3 * tap + (1 + odd_column) * tap, narrow)
            columns = (width - 1 - odd_column) // 2
            product(columns, wide, out, a, b, (c, 0, len(bias) > 1), steps[odd][odd_column], mode)


@compiled(PLANES, PLANES, KERNEL)
def correlate(big, small, weights):
    """Add to `weights` their gradient in `gather` and `scatter`, from values and a gradient."""
    _, width, wide, _ = big.shape
    height, across, narrow, _ = small.shape
    x, y, w = big.reshape(-1), small.reshape(-1), weights.reshape(-1)
    zero, part = np.zeros(LANES, np.float32), np.zeros_like(w)
    steps = _sum((1, 1, across - 2), (0, 0, 2 * wide), (0, 0, narrow))
    for row in range(height - 2):
        b = (y, ((row + 1) * across + 1) * narrow, 1)
        for tap in range(3):
            out, a = (part, tap * 3 * wide * narrow, narrow), (x, (2 * row + tap) * width * wide, 1)
            product(3 * wide, narrow, out, a, b, (zero, 0, 0), steps, ADD)
    w += part


@compiled(PLANES, MATRIX)
def total(values, sums):
    """Add to `sums` (channel, lane) the values (row, column, channel, lane) of each channel."""
    rows, columns, channels, _ = values.shape
    x, y = values.reshape(-1), sums.reshape(-1)
    zero, one, part = np.zeros(LANES, np.float32), np.ones(LANES, np.float32), np.zeros_like(y)
    steps = _sum((1, 1, columns), (0, 0, 0), (0, 0, channels))
    for row in range(rows):
        b = (x, row * columns * channels, 1)
        product(1, channels, (part, 0, 0), (one, 0, 0), b, (zero, 0, 0), steps, ADD)
    y += part


@compiled(ROWS, ROWS, types.boolean, MATRIX, ROWS, types.intp)
def dense(x, weights, transposed, bias, y, mode):
    """Compute y (row, output, lane) = bias + x (row, input, lane) weights (input, output, lane).

    `transposed`: weights are (output, input, lane), so that y is the gradient with respect to another layer's x.
    """
    inputs, (rows, outputs, _) = x.shape[1], y.shape
    step, stride = (1, inputs) if transposed else (outputs, 1)
    out, a, b = (y.reshape(-1), 0, outputs), (x.reshape(-1), 0, inputs), (weights.reshape(-1), 0, stride)
    steps = _sum((1, 1, inputs), (0, 0, 1), (0, 0, step))
    product(rows, outputs, out, a, b, (bias.reshape(-1), 0, len(bias) > 1), steps, mode)


@compiled(ROWS, ROWS, ROWS)
def dense_weights(x, dy, weights):
    """Add to `weights` the gradient of `dense` with respect to its weights."""
    inputs, outputs, _ = weights.shape
    out, a, b = (weights.reshape(-1), 0, outputs), (x.reshape(-1), 0, 1), (dy.reshape(-1), 0, 1)
    steps = _sum((1, 1, len(x)), (0, 0, inputs), (0, 0, outputs))
    product(inputs, outputs, out, a, b, (np.zeros(LANES, np.float32), 0, 0), steps, ADD)


@compiled(IMAGE, ROWS, ROWS, PLANES, PLANES)
def standardise(image, centre, factor, intensities, standardised):
    """Write an image's intensities, 0 to 1, and (intensity - centre) * factor into planes, inside their borders.

    centre, factor: (column, channel, lane), the same in each column, so that a row is one loop.
    """
    c, f = centre.reshape(-1), factor.reshape(-1)
    for row in range(len(image)):
        x = image[row].reshape(-1)
        y, z = intensities[row + 1, 1:-1].reshape(-1), standardised[row + 1, 1:-1].reshape(-1)
        for i in range(len(x)):
            y[i] = np.float32(x[i]) / np.float32(255)
        for i in range(len(x)):
            z[i] = (y[i] - c[i]) * f[i]


@compiled(PLANES, PLANES, types.float32, MATRIX)
def squared_error(logits, image, scale, error):
    """Add to `error` (1, lane) that of sigmoid(logits), squared; its gradient times scale / 2 overwrites the logits."""
    height, width, channels, _ = logits.shape
    x, y, sums = logits.reshape(-1), image.reshape(-1), error.reshape(-1)
    for row in range(1, height - 1):
        first = (row * width + 1) * channels
        tile = zeros(1, 1)
        for i in range(first, first + (width - 2) * channels):
            tile = _squared_error(tile, x, y, i, scale)
        _add(tile, sums, 0, 0)
