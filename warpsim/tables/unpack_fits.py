"""A script, run in a process of its own: unpack the tile-compressed images of a FITS file.

Decompressors of damaged tiles write beyond their memory, which ends a process or worse; this one has nothing to lose.
It reads the file from standard input, with at most the bytes of memory that its argument says, and writes a FITS file
whose images are plain.
"""

import contextlib
import io
import sys
import warnings

from astropy.io import fits


def main() -> None:
    """Unpack standard input to standard output."""
    with contextlib.suppress(ImportError, ValueError, OSError):  # no such limits on this system
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[1]), int(sys.argv[1])))
    warnings.simplefilter("ignore")
    unpacked = io.BytesIO()
    with fits.open(io.BytesIO(sys.stdin.buffer.read())) as hdus:
        plain = [
            fits.ImageHDU(hdu.data, hdu.header) if isinstance(hdu, fits.CompImageHDU) else hdu.copy() for hdu in hdus
        ]
        fits.HDUList(plain).writeto(unpacked, output_verify="silentfix")
    sys.stdout.buffer.write(unpacked.getvalue())


if __name__ == "__main__":
    main()
