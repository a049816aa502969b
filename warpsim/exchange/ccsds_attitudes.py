"""CCSDS AEM (attitudes, in text or XML), 504.0-B-1/2, as segments."""

from __future__ import annotations

import re

import numpy as np

from warpsim.arrays import F64
from warpsim.exchange.ccsds_message import MessageSegment, check_center, common_fields, read_message
from warpsim.exchange.segments import AttitudeSegment, Frame, ccsds_frame
from warpsim.exchange.source import Keywords, SourceFile
from warpsim.quaternion import conjugate, product, rotated

_NEEDED = ("REF_FRAME_A", "REF_FRAME_B", "ATTITUDE_TYPE")
_OPTIONAL = ("INTERPOLATION_METHOD", "CENTER_NAME", "ATTITUDE_DIR", "QUATERNION_TYPE", "EULER_ROT_SEQ")
_RATE_FRAMES = ("RATE_FRAME", "ANGVEL_FRAME")
_N_QUATERNION_CELLS = {"QUATERNION": 5, "QUATERNION/DERIVATIVE": 9, "QUATERNION/RATE": 8, "QUATERNION/ANGVEL": 8}
_OF_AN_ORBIT = ("LVLH", "RSW", "RTN", "TNW", "QSW", "NTW", "VNC", "PQW", "VVLH")


def read_aem(source: SourceFile) -> list[AttitudeSegment]:
    """Segments of an AEM."""
    version, segments = read_message(source, "AEM", _NEEDED, (*_OPTIONAL, *_RATE_FRAMES))
    return [_attitude(segment, version) for segment in segments]


def _attitude(segment: MessageSegment, version: float) -> AttitudeSegment:
    meta = segment.meta
    check_center(meta)
    frame, body_frame, a_is_body = _frames(meta)
    common = common_fields(segment, "INTERPOLATION_METHOD")
    kind = meta.text("ATTITUDE_TYPE").upper().replace(" ", "_").replace("EULER_ANGLES", "EULER_ANGLE")
    rates = None
    if kind in _N_QUATERNION_CELLS:
        quaternion, rates = _quaternions(segment, kind, version)
    elif kind == "EULER_ANGLE":
        quaternion = _from_euler_angles(segment)
    else:
        known = ", ".join((*_N_QUATERNION_CELLS, "EULER_ANGLE"))
        raise meta.error("ATTITUDE_TYPE", f"must be one of {known}", kind)
    # A quaternion of A to B turns components in B into those in A (it is the turn that carries A's axes to B's).
    if version < 2.0:
        meta.need("ATTITUDE_DIR", part="metadata")
    backwards = a_is_body != (meta.one_of("ATTITUDE_DIR", ("A2B", "B2A"), "A2B") == "B2A")
    turned = conjugate(quaternion) if backwards else quaternion
    rate_rad_s = None
    if kind == "QUATERNION/DERIVATIVE" and rates is not None:
        rate_rad_s = 2.0 * product(conjugate(turned), conjugate(rates) if backwards else rates)[:, :3]
    elif rates is not None:
        rate_rad_s = _body_rates(meta, np.radians(rates), turned, a_is_body)
    return AttitudeSegment(frame=frame, body_frame=body_frame, quaternion=turned, rate_rad_s=rate_rad_s, **common)


def _body_rates(meta: Keywords, rate: F64, quaternion: F64, a_is_body: bool) -> F64:
    """Angular velocities of the body in its own axes, from those of frame B relative to A in the axes of either."""
    keyword = next((name for name in reversed(_RATE_FRAMES) if name in meta), None)
    in_body = True
    if keyword is not None:
        stated = meta.text(keyword).upper()
        in_a = stated in ("REF_FRAME_A", meta.text("REF_FRAME_A").upper())
        if not in_a and stated not in ("REF_FRAME_B", meta.text("REF_FRAME_B").upper()):
            raise meta.error(keyword, "must be REF_FRAME_A or REF_FRAME_B", meta.text(keyword), "ANGVEL_FRAME")
        in_body = in_a == a_is_body
    rate = rate if in_body else rotated(conjugate(quaternion), rate)
    return -rate if a_is_body else rate


def _frames(meta: Keywords) -> tuple[Frame, str, bool]:
    """Reference frame, the body's name for its own, and whether the body is frame A."""
    names = {keyword: meta.text(keyword) for keyword in ("REF_FRAME_A", "REF_FRAME_B")}
    a, b = names.values()
    frame_a, frame_b = ccsds_frame(a), ccsds_frame(b)
    if (frame_a is None) == (frame_b is None):
        rule = f"must be a frame of the Earth or the sky and one of the body, got {a!r} and {b!r}"
        raise meta.error("REF_FRAME_A", rule, field="REF_FRAME_A, REF_FRAME_B")
    for keyword, name in names.items():
        if name.upper().startswith(_OF_AN_ORBIT):
            raise meta.error(keyword, "must not be an orbit's frame", name, "REF_FRAME")
    if frame_a is not None:
        return frame_a, b, False
    assert frame_b is not None
    return frame_b, a, True


def _quaternions(segment: MessageSegment, kind: str, version: float) -> tuple[F64, F64 | None]:
    """Quaternions of the rows, scalar last, and what stands beside them: derivatives of these, or rates [deg/s]."""
    meta, rows = segment
    is_xml = meta.source.is_xml
    n_cell = 5 if is_xml else _N_QUATERNION_CELLS[kind]
    rows.check(n_cell, "a date, a quaternion, and its rate where ATTITUDE_TYPE says so")
    values = rows.numbers(1, n_cell - 1)
    if version < 2.0 and not is_xml:
        meta.need("QUATERNION_TYPE", part="metadata")
    # In XML the components have names, so their order says nothing.
    first = meta.one_of("QUATERNION_TYPE", ("FIRST", "LAST")) == "FIRST" and not is_xml
    scalar_last = [1, 2, 3, 0] if first else [0, 1, 2, 3]
    quaternion, beside = values[:, scalar_last], values[:, 4:]
    if n_cell == 5:
        return quaternion, None
    return quaternion, beside if n_cell == 8 else beside[:, scalar_last]


def _from_euler_angles(segment: MessageSegment) -> F64:
    """Quaternions of turns about three axes, one after the other, each about the axes as turned so far."""
    from scipy.spatial.transform import Rotation

    meta, rows = segment
    meta.need("EULER_ROT_SEQ", part="metadata")
    rows.check(4, "a date and three angles")
    angle_deg = rows.numbers(1, 3)
    sequence = meta.text("EULER_ROT_SEQ")
    axes = sequence.upper().translate(str.maketrans("123", "XYZ"))
    if not re.fullmatch(r"(?!(.)\1)(?!.(.)\2)[XYZ]{3}", axes):
        raise meta.error("EULER_ROT_SEQ", "must be three axes like ZXZ or 321", sequence[:20])
    return np.asarray(Rotation.from_euler(axes, angle_deg, degrees=True).as_quat(), np.float64)
