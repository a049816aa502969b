"""Pixel fractions and their derivatives by the source's position, in float64, of the tables that stamps are drawn with.

The interpolation is that of `psf.py` and `psf_cells.py`, cell by cell, and so is its derivative: of the image that is
drawn, not of the pattern behind it. Where a source crosses an edge between cells, derivatives are those of the cell
that it is drawn by.

A stamp takes the same weights for all of its pixels. So sums over a stamp of a cotangent times fractions are found
without any of these: the cotangent is summed over the stamp times what the table holds, and only the sums are
weighted.
"""

import functools
import math
from typing import Any, NamedTuple

import warp as wp

from warpsim_kernels.psf import TABLE_SIMD_WIDTH, TablePsf, table_functions
from warpsim_kernels.psf_cells import cell_functions
from warpsim_kernels.shared_memory import load
from warpsim_kernels.table_layout import TableLayout, n_term_of

Wide = wp.types.vector(length=TABLE_SIMD_WIDTH, dtype=wp.float64)


class SlopeFunctions(NamedTuple):
    """Functions of the tables of a layout."""

    Sums: Any
    """Matrix (n, TABLE_SIMD_WIDTH) of sums over a stamp, column by column of its blocks."""

    Slopes: Any
    """Struct: weights of the fractions of a source, and their derivatives."""

    slopes_in: Any
    """(dx_px: float64, dy_px: float64, psf: TablePsf) -> slopes; offsets as those of `offset_in`."""

    add_row: Any
    """(sums, cotangent: array of float, table: array of float, psf, slopes, row, step: int, block: int, span: RowSpan)
    -> sums with the pixels of the row that is step pixels from the source's own, from a block of the table on."""

    totals: Any
    """(sums, slopes) -> vec3d: the cotangent times fractions and their derivatives by x and y, summed."""

    pixel: Any
    """(table: array of float, psf, slopes, row, step: int, pixel: int) -> vec3d: fraction of one pixel, counted from
    the first one of the first block, and its derivatives by x and y."""


def slope_functions(layout: TableLayout) -> SlopeFunctions:
    """Return the functions of tables of a layout."""
    return cell_slopes(layout.degree) if layout.degree else node_slopes(layout.n_point)


@wp.struct
class RowSpan:
    """Pixels of a row of the cotangent; columns count from the first pixel of a block."""

    pixel: int  # index of that pixel in the flat array; it may be one of another row
    first: int
    end: int


_ROW_LOOP = """
#if defined(__clang__)
    typedef float narrow __attribute__((vector_size(32), aligned(4)));
    typedef double wide __attribute__((vector_size(64)));
#define WIDE(p) __builtin_convertvector(*(const narrow*)(p), wide)
#else
    struct wide {{
        double c[8];
        CUDA_CALLABLE double& operator[](int i) {{ return c[i]; }}
        CUDA_CALLABLE wide operator*(double s) const {{
            wide r;
            for (int i = 0; i < 8; ++i) r.c[i] = c[i] * s;
            return r;
        }}
        CUDA_CALLABLE wide operator*(const wide& o) const {{
            wide r;
            for (int i = 0; i < 8; ++i) r.c[i] = c[i] * o.c[i];
            return r;
        }}
        CUDA_CALLABLE void operator+=(const wide& o) {{ for (int i = 0; i < 8; ++i) c[i] += o.c[i]; }}
        CUDA_CALLABLE static wide of(const float* p) {{ wide r; for (int i = 0; i < 8; ++i) r.c[i] = p[i]; return r; }}
    }};
#define WIDE(p) wide::of(p)
#endif
    wide total[{n}];
    for (int k = 0; k < {n}; ++k)
        for (int i = 0; i < 8; ++i)
            total[k][i] = sums.data[k][i];
    for (int column = 0; column < span.end; column += 8) {{
        wide c;
        if (column >= span.first && column + 8 <= span.end)
            c = WIDE(cotangent.data + span.pixel + column);
        else
            for (int i = 0; i < 8; ++i) {{
                bool own = column + i >= span.first && column + i < span.end;
                c[i] = own ? double(cotangent.data[span.pixel + column + i]) : 0.0;
            }}
        const float* near = table.data + at;
        {body}
        at += step;
    }}
    for (int k = 0; k < {n}; ++k)
        for (int i = 0; i < 8; ++i)
            sums.data[k][i] = total[k][i];
#undef WIDE
    return sums;
"""
"""Loop over the blocks of a row, in C++: only so do eight sums at a time stay in registers. Eight: TABLE_SIMD_WIDTH."""


@wp.func
def wing_slopes(psf: TablePsf, x_px: wp.float64, y_px: wp.float64) -> wp.vec3d:
    """Fraction of a pixel beyond the table, as `table_wing`, and its derivatives by the source's x and y.

    Args:
        psf: The pattern.
        x_px: Pixel centre minus source along columns [pixel widths].
        y_px: The same along rows [pixel widths].
    """
    one = wp.float64(1.0)
    two = wp.float64(2.0)
    x2 = x_px * x_px
    inverse2 = one / (x2 + y_px * y_px)
    aspect = wp.float64(psf.wing_aspect_px2)
    inner = (aspect * x2 + wp.float64(psf.wing_last_px4)) * inverse2
    more = (wp.float64(psf.wing_next_px2) + inner) * inverse2
    power = wp.float64(psf.wing_px3) * inverse2 * wp.sqrt(inverse2)
    # By r^2: power goes as its -3/2, more as next / r^2 + (aspect x^2 + last) / r^4.
    by_r2 = -power * inverse2 * (wp.float64(1.5) * (one + more) + more + inner * inverse2)
    by_x = two * x_px * (by_r2 + power * aspect * inverse2 * inverse2)
    return wp.vec3d(power * (one + more), -by_x, -two * y_px * by_r2 * wp.float64(psf.pixel_aspect))


@functools.cache
def cell_slopes(degree: int) -> SlopeFunctions:
    """Functions of polynomials in cells."""
    n_term = n_term_of(degree)
    Row = cell_functions(degree).Row
    Sums = wp.types.matrix(shape=(n_term, TABLE_SIMD_WIDTH), dtype=wp.float64)
    Terms = wp.types.vector(length=n_term, dtype=wp.float64)
    Powers = wp.types.vector(length=degree + 1, dtype=wp.float64)
    degrees = Powers(*range(degree + 1))

    @wp.func
    def chebyshev(t: wp.float64) -> Powers:
        """Chebyshev's polynomials at t in [-1, 1]."""
        value = Powers()
        value[0] = wp.float64(1.0)
        value[1] = t
        for k in range(2, wp.static(degree + 1)):
            value[k] = wp.float64(2.0) * t * value[k - 1] - value[k - 2]
        return value

    @wp.func
    def chebyshev_slope(t: wp.float64) -> Powers:
        """Their derivatives: k times those of the second kind, of one degree less."""
        second = Powers()
        second[0] = wp.float64(1.0)
        second[1] = wp.float64(2.0) * t
        numbers = degrees
        slope = Powers()
        slope[1] = wp.float64(1.0)
        for k in range(2, wp.static(degree + 1)):
            slope[k] = numbers[k] * second[k - 1]
            second[k] = wp.float64(2.0) * t * second[k - 1] - second[k - 2]
        return slope

    @wp.func
    def terms_of(across: Powers, down: Powers) -> Terms:
        """Products in the order of the tables."""
        terms = Terms()
        for j in range(wp.static(degree + 1)):
            for i in range(wp.static(degree + 1)):
                if i + j <= wp.static(degree):
                    terms[j * wp.static(degree + 1) - j * (j - 1) // 2 + i] = down[j] * across[i]
        return terms

    class CellSlopes:
        value: Terms
        by_x: Terms
        by_y: Terms

    Slopes = wp.struct(CellSlopes)

    @wp.func
    def slopes_in(dx_px: wp.float64, dy_px: wp.float64, psf: TablePsf) -> Slopes:
        half = wp.float64(0.5)
        one = wp.float64(1.0)
        two = wp.float64(2.0)
        y_px = dy_px
        first_cell_row = int(0)
        upright = one
        if psf.mirrored != 0:
            first_cell_row = psf.row_per_px // 2
            if dy_px < wp.float64(0.0):
                y_px = -dy_px
                upright = -one
        x = (dx_px + half) * wp.float64(psf.column_per_px)
        y = (y_px + half) * wp.float64(psf.row_per_px)
        column = wp.clamp(int(x), 0, psf.column_per_px - 1)
        row = wp.clamp(int(y), first_cell_row, psf.row_per_px - 1)
        t_x = two * (x - wp.float64(column)) - one
        t_y = two * (y - wp.float64(row)) - one
        across = chebyshev(t_x)
        down = chebyshev(t_y)
        slopes = Slopes()
        slopes.value = terms_of(across, down)
        slopes.by_x = terms_of(chebyshev_slope(t_x), down) * (-two * wp.float64(psf.column_per_px))
        slopes.by_y = terms_of(across, chebyshev_slope(t_y)) * (-two * upright * wp.float64(psf.row_per_px))
        return slopes

    body = f"""
            #pragma unroll
            for (int k = 0; k < {n_term}; ++k)
                total[k] += c * WIDE(near + k * 8);"""

    @wp.func_native(snippet=_ROW_LOOP.format(n=n_term, body=body))
    def add_blocks(
        sums: Sums, cotangent: wp.array[float], table: wp.array[float], span: RowSpan, at: int, step: int
    ) -> Sums:
        """Sums with the blocks of a row, whose polynomials begin at `at`, each `step` floats behind the one before."""

    @wp.func
    def add_row(
        sums: Sums, cotangent: wp.array[float], table: wp.array[float], psf: TablePsf, slopes: Slopes, row: Row,
        step: int, block: int, span: RowSpan,
    ) -> Sums:  # fmt: skip
        pitch = psf.n_row * wp.static(n_term * TABLE_SIMD_WIDTH)
        per_vector = TABLE_SIMD_WIDTH // psf.block_px
        return add_blocks(sums, cotangent, table, span, row.first + block * pitch, per_vector * pitch)

    @wp.func
    def totals(sums: Sums, slopes: Slopes) -> wp.vec3d:
        total = wp.vec3d()
        for k in range(wp.static(n_term)):
            part = wp.float64(0.0)
            for i in range(TABLE_SIMD_WIDTH):
                part += sums[k, i]
            total += part * wp.vec3d(slopes.value[k], slopes.by_x[k], slopes.by_y[k])
        return total

    @wp.func_native(
        snippet=f"""
        const float* near = table.data + at;
        double value = 0.0, across = 0.0, down = 0.0;
        #pragma unroll
        for (int k = 0; k < {n_term}; ++k) {{
            const double c = near[k * {TABLE_SIMD_WIDTH}];
            value += c * by_light[k];
            across += c * by_x[k];
            down += c * by_y[k];
        }}
        return wp::vec_t<3, wp::float64>(value, across, down);"""
    )
    def weighted(table: wp.array[float], at: int, by_light: Terms, by_x: Terms, by_y: Terms) -> wp.vec3d:
        """Sums of a pixel's coefficients, which begin at `at`, with weights of three kinds."""

    @wp.func
    def pixel(table: wp.array[float], psf: TablePsf, slopes: Slopes, row: Row, step: int, pixel: int) -> wp.vec3d:
        block = wp.min(pixel // psf.block_px, psf.n_block - 1)
        at = row.first + block * psf.n_row * wp.static(n_term * TABLE_SIMD_WIDTH) + pixel - block * psf.block_px
        return weighted(table, at, slopes.value, slopes.by_x, slopes.by_y)

    return SlopeFunctions(Sums, Slopes, slopes_in, add_row, totals, pixel)


@functools.cache
def node_slopes(n_point: int) -> SlopeFunctions:
    """Functions of Lagrange's polynomials through nodes."""
    n_before = n_point // 2 - 1
    Row = table_functions(n_point).Row
    Sums = wp.types.matrix(shape=(2 * n_point, TABLE_SIMD_WIDTH), dtype=wp.float64)
    Weights = wp.types.vector(length=n_point, dtype=wp.float64)
    Both = wp.types.vector(length=2 * n_point, dtype=wp.float64)
    node_numbers = range(-n_before, n_point - n_before)
    scale = Weights(*(1.0 / math.prod(k - j for j in node_numbers if j != k) for k in node_numbers))

    @wp.func
    def lagrange(u: wp.float64) -> Both:
        """Weights of the nodes at the point u in [0, 1], and behind them their derivatives."""
        both = Both()
        product = wp.float64(1.0)
        slope = wp.float64(0.0)
        for k in range(wp.static(n_point)):  # products of the factors of the nodes before
            both[k] = product
            both[wp.static(n_point) + k] = slope
            factor = u - wp.float64(k - wp.static(n_before))
            slope = slope * factor + product
            product = product * factor
        product = wp.float64(1.0)
        slope = wp.float64(0.0)
        for i in range(wp.static(n_point)):  # and of those behind
            k = wp.static(n_point - 1) - i
            both[wp.static(n_point) + k] = scale[k] * (both[wp.static(n_point) + k] * product + both[k] * slope)
            both[k] = scale[k] * both[k] * product
            factor = u - wp.float64(k - wp.static(n_before))
            slope = slope * factor + product
            product = product * factor
        return both

    class NodeSlopes:
        across: Both
        down: Both
        turned: Both  # the same as down, of rows that the table serves by their mirror images
        node: int  # the one before dy, counted from dy = 0

    Slopes = wp.struct(NodeSlopes)

    @wp.func
    def slopes_in(dx_px: wp.float64, dy_px: wp.float64, psf: TablePsf) -> Slopes:
        slopes = Slopes()
        position = dx_px * wp.float64(psf.column_per_px)
        slopes.across = lagrange(position - wp.floor(position))
        position = dy_px * wp.float64(psf.row_per_px)
        node = wp.floor(position)
        slopes.node = int(node)
        slopes.down = lagrange(position - node)
        slopes.turned = slopes.down
        for k in range(wp.static(n_point)):
            if position > node:
                slopes.turned[k] = slopes.down[wp.static(n_point - 1) - k]
                slopes.turned[wp.static(n_point) + k] = slopes.down[wp.static(2 * n_point - 1) - k]
            else:  # on a node, as its mirror image is
                slopes.turned[wp.static(n_point) + k] = -slopes.down[wp.static(n_point) + k]
        for k in range(wp.static(n_point)):
            slopes.across[wp.static(n_point) + k] *= -wp.float64(psf.column_per_px)
            slopes.down[wp.static(n_point) + k] *= -wp.float64(psf.row_per_px)
            slopes.turned[wp.static(n_point) + k] *= -wp.float64(psf.row_per_px)
        return slopes

    @wp.func
    def down_of(psf: TablePsf, slopes: Slopes, step: int) -> Both:
        """Weights and slopes along dy, of a row that is step pixels from the source's own."""
        if psf.mirrored != 0 and slopes.node + step * psf.row_per_px < 0:
            return slopes.turned
        return slopes.down

    body = f"""
            for (int j = 0; j < {n_point}; ++j) {{
                wide value = c * down.c[j];
                wide slope = c * down.c[{n_point} + j];
                #pragma unroll
                for (int k = 0; k < {n_point}; ++k) {{
                    wide part = WIDE(near + k * 8);
                    total[k] += value * part;
                    total[{n_point} + k] += slope * part;
                }}
                near += pitch;
            }}"""

    @wp.func_native(snippet=_ROW_LOOP.format(n=2 * n_point, body=body))
    def add_blocks(
        sums: Sums, cotangent: wp.array[float], table: wp.array[float], span: RowSpan, at: int, step: int, down: Both,
        pitch: int,
    ) -> Sums:  # fmt: skip
        """Sums with the blocks of a row, whose nodes begin at `at`, each `step` floats behind the one before."""

    @wp.func
    def add_row(
        sums: Sums, cotangent: wp.array[float], table: wp.array[float], psf: TablePsf, slopes: Slopes, row: Row,
        step: int, block: int, span: RowSpan,
    ) -> Sums:  # fmt: skip
        pitch = psf.n_phase * TABLE_SIMD_WIDTH
        at = row.first + block * pitch
        down = down_of(psf, slopes, step)
        return add_blocks(sums, cotangent, table, span, at, pitch, down, psf.n_block * pitch)

    @wp.func
    def totals(sums: Sums, slopes: Slopes) -> wp.vec3d:
        total = wp.vec3d()
        for k in range(wp.static(n_point)):
            value = wp.float64(0.0)
            slope = wp.float64(0.0)
            for i in range(TABLE_SIMD_WIDTH):
                value += sums[k, i]
                slope += sums[wp.static(n_point) + k, i]
            weight = slopes.across[k]
            total += wp.vec3d(weight * value, slopes.across[wp.static(n_point) + k] * value, weight * slope)
        return total

    @wp.func
    def pixel(table: wp.array[float], psf: TablePsf, slopes: Slopes, row: Row, step: int, pixel: int) -> wp.vec3d:
        block = pixel // TABLE_SIMD_WIDTH
        at = row.first + (block * psf.n_phase - block) * TABLE_SIMD_WIDTH + pixel
        down = down_of(psf, slopes, step)
        total = wp.vec3d()
        j = int(0)
        while j < wp.static(n_point):
            value = wp.float64(0.0)
            by_x = wp.float64(0.0)
            for k in range(wp.static(n_point)):
                node = wp.float64(load(table, at + TABLE_SIMD_WIDTH * k))
                value += slopes.across[k] * node
                by_x += slopes.across[wp.static(n_point) + k] * node
            total += wp.vec3d(down[j] * value, down[j] * by_x, down[wp.static(n_point) + j] * value)
            at += psf.n_block * psf.n_phase * TABLE_SIMD_WIDTH
            j += 1
        return total

    return SlopeFunctions(Sums, Slopes, slopes_in, add_row, totals, pixel)
