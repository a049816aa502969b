"""Pixel fractions of a point source by polynomials: one for each pixel of a stamp and each cell of the source's pixel.

The pixel that holds the source is cut into cells; in each of them the fraction that a pixel collects is a polynomial of
the offset, in Chebyshev's basis, up to a total degree. All that a stamp reads then stands together in memory, row after
row, and takes half the arithmetic of an interpolation between nodes (psf.py) that is as good.
"""

import functools

import warp as wp

from warpsim_kernels.psf import TABLE_SIMD_WIDTH, TableFunctions, TablePsf, table_functions
from warpsim_kernels.shared_memory import load
from warpsim_kernels.table_layout import CELL_DEGREES, TableLayout, n_term_of


def layout_functions(layout: TableLayout) -> TableFunctions:
    """Return the functions that read tables of a layout."""
    return cell_functions(layout.degree) if layout.degree else table_functions(layout.n_point)


@functools.cache
def cell_functions(degree: int) -> TableFunctions:
    """Return the functions that read tables of polynomials, with the interface of `table_functions`.

    Of a TablePsf, n_row counts rows of pixels, zero_row is that of the source's own pixel, column_per_px and row_per_px
    count cells. A table is (n_cell_row, n_cell_column, n_block, n_row, n_term, TABLE_SIMD_WIDTH); a mirrored one holds
    the cells of dy >= 0 only. Terms are in the order of `terms_of`.

    Args:
        degree: Total degree, one of CELL_DEGREES, as the tables were fitted.
    """
    if degree not in CELL_DEGREES:
        raise ValueError(f"degree: must be one of {CELL_DEGREES}, got {degree}")
    n_term = n_term_of(degree)
    PixelVector = wp.types.vector(length=TABLE_SIMD_WIDTH, dtype=wp.float32)
    Nodes = wp.types.vector(length=n_term * TABLE_SIMD_WIDTH, dtype=wp.float32)
    Terms = wp.types.vector(length=n_term, dtype=wp.float32)
    Powers = wp.types.vector(length=degree + 1, dtype=wp.float32)

    @wp.func
    def chebyshev(t: float) -> Powers:
        """Chebyshev's polynomials of the degrees 0 ... degree at t in [-1, 1]."""
        value = Powers()
        value[0] = 1.0
        value[1] = t
        for k in range(2, wp.static(degree + 1)):
            value[k] = 2.0 * t * value[k - 1] - value[k - 2]
        return value

    @wp.func
    def terms_of(across: Powers, down: Powers) -> Terms:
        """Products down[j] across[i] with i + j <= degree, i running fastest."""
        terms = Terms()
        for j in range(wp.static(degree + 1)):
            for i in range(wp.static(degree + 1)):
                if i + j <= wp.static(degree):
                    terms[j * wp.static(degree + 1) - j * (j - 1) // 2 + i] = down[j] * across[i]
        return terms

    class CellOffset:
        dx_px: float  # of the source's own pixel [pixel widths]
        dy_px: float
        first_step: int  # columns that the table serves, in pixels from the source's own
        end_step: int
        first_row_step: int  # rows likewise
        end_row_step: int
        start: int  # index in the flat array of the polynomials of the source's own row
        pitch: int  # from there to those of the next row; negative where the table is read upside down
        across: Powers
        down: Powers

    class CellRow:
        distance_px: float
        first: int  # index in the flat array of the polynomials of the row

    offset_type = wp.struct(CellOffset)
    row_type = wp.struct(CellRow)

    @wp.func
    def served_steps(offset_px: wp.float64, reach_px: float) -> wp.vec2i:
        """First step from the source's own pixel, and one past the last, with an offset below the reach."""
        reach = wp.float64(reach_px)
        return wp.vec2i(int(wp.floor(-reach - offset_px)) + 1, int(wp.ceil(reach - offset_px)))

    @wp.func
    def offset_in(dx_px: wp.float64, dy_px: wp.float64, psf: TablePsf) -> offset_type:
        offset = offset_type()
        offset.dx_px = float(dx_px)
        offset.dy_px = float(dy_px) * psf.pixel_aspect
        steps = served_steps(dx_px, psf.reach_column_px)
        offset.first_step = steps[0]
        offset.end_step = steps[1]
        steps = served_steps(dy_px, psf.reach_row_px)
        offset.first_row_step = steps[0]
        offset.end_row_step = steps[1]
        offset.pitch = wp.static(n_term * TABLE_SIMD_WIDTH)
        y_px = dy_px
        first_cell_row = int(0)
        if psf.mirrored != 0:
            first_cell_row = psf.row_per_px // 2
            if dy_px < wp.float64(0.0):
                y_px = -dy_px
                offset.pitch = -offset.pitch
        # In float64 up to the fraction of a cell: P is steep where the source crosses the pixel's edge.
        half = wp.float64(0.5)
        x = (dx_px + half) * wp.float64(psf.column_per_px)
        y = (y_px + half) * wp.float64(psf.row_per_px)
        column = wp.clamp(int(x), 0, psf.column_per_px - 1)
        row = wp.clamp(int(y), first_cell_row, psf.row_per_px - 1)
        offset.across = chebyshev(2.0 * float(x - wp.float64(column)) - 1.0)
        offset.down = chebyshev(2.0 * float(y - wp.float64(row)) - 1.0)
        cell = (row - first_cell_row) * psf.column_per_px + column
        rows = cell * psf.n_block * psf.n_row + psf.zero_row
        offset.start = psf.start + rows * wp.static(n_term * TABLE_SIMD_WIDTH)
        return offset

    @wp.func
    def row_in(offset: offset_type, step: int, psf: TablePsf) -> row_type:
        row = row_type()
        row.distance_px = offset.dy_px + float(step) * psf.pixel_aspect
        row.first = -1
        if step >= offset.first_row_step and step < offset.end_row_step:
            row.first = offset.start + step * offset.pitch
        return row

    @wp.func
    def fractions(nodes: wp.array[Nodes], psf: TablePsf, offset: offset_type, row: row_type, block: int) -> PixelVector:
        near = nodes[row.first + block * psf.n_row * wp.static(n_term * TABLE_SIMD_WIDTH)]
        terms = terms_of(offset.across, offset.down)
        # Three sums, as each addition waits for the one before.
        one = terms[0] * near[0:TABLE_SIMD_WIDTH]
        two = terms[1] * near[TABLE_SIMD_WIDTH : wp.static(2 * TABLE_SIMD_WIDTH)]
        three = terms[2] * near[wp.static(2 * TABLE_SIMD_WIDTH) : wp.static(3 * TABLE_SIMD_WIDTH)]
        for k in range(3, wp.static(n_term)):
            part = terms[k] * near[wp.static(TABLE_SIMD_WIDTH * k) : wp.static(TABLE_SIMD_WIDTH * (k + 1))]
            if wp.static(k % 3 == 0):
                one = one + part
            elif wp.static(k % 3 == 1):
                two = two + part
            else:
                three = three + part
        return one + (two + three)

    @wp.func
    def fraction(table: wp.array[float], psf: TablePsf, offset: offset_type, row: row_type, pixel: int) -> float:
        block = wp.min(pixel // psf.block_px, psf.n_block - 1)
        at = row.first + block * psf.n_row * wp.static(n_term * TABLE_SIMD_WIDTH) + pixel - block * psf.block_px
        sums = wp.vec3()
        for j in range(wp.static(degree + 1)):
            for i in range(wp.static(degree + 1)):
                if i + j <= wp.static(degree):
                    k = j * wp.static(degree + 1) - j * (j - 1) // 2 + i
                    term = offset.down[j] * offset.across[i]
                    sums[k % 3] = sums[k % 3] + term * load(table, at + TABLE_SIMD_WIDTH * k)
        return sums[0] + (sums[1] + sums[2])

    return TableFunctions(Nodes, offset_type, row_type, offset_in, row_in, fractions, fraction)
