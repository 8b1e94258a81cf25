"""The smallest policies that each format holds: u = W o for an observation o."""

import numpy as np


def write_onnx(path, matrix):
    """Write an ONNX file whose one node multiplies the observation (1, n) by a matrix (n, k)."""
    n, k = matrix.shape
    weights = b"".join([
        _number(1, n), _number(1, k), _number(2, 1), _text(8, "W"),
        _bytes(9, matrix.astype("<f4").tobytes()),
    ])  # fmt: skip
    node = _text(1, "o") + _text(1, "W") + _text(2, "u") + _text(4, "MatMul")
    graph = b"".join([
        _bytes(1, node), _text(2, "graph"), _bytes(5, weights), _bytes(11, _value("o", n)),
        _bytes(12, _value("u", k)),
    ])  # fmt: skip
    opset = _text(1, "") + _number(2, 13)
    path.write_bytes(_number(1, 8) + _bytes(7, graph) + _bytes(8, opset))
    return path


def _value(name, size):
    """Return ValueInfoProto of float32 (1, size)."""
    sizes = _bytes(1, _number(1, 1)) + _bytes(1, _number(1, size))
    return _text(1, name) + _bytes(2, _bytes(1, _number(1, 1) + _bytes(2, sizes)))


def _varint(value):
    out = b""
    while value > 127:
        out += bytes([value % 128 + 128])
        value //= 128
    return out + bytes([value])


def _number(field, value):
    return _varint(8 * field) + _varint(value)


def _bytes(field, content):
    return _varint(8 * field + 2) + _varint(len(content)) + content


def _text(field, text):
    return _bytes(field, text.encode())


def gains(n, kp=2.0, kd=3.0):
    """Return W (2, n) of u = kp (p_ref − p) + kd (v_ref − v), as observations have these."""
    matrix = np.zeros((2, n), dtype=np.float32)
    matrix[:, :4] = np.hstack([kp * np.eye(2), kd * np.eye(2)])
    return matrix
