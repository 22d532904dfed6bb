"""Reads and writes the PLY files of sequence folders and of the server."""
import pathlib

import numpy as np

_TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
          "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
          "int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8"}
_CLOUD = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("label", "<u2")])


def _header(data, path):
    end = data.find(b"end_header\n")
    lines = data[:end].decode("ascii", "replace").splitlines()
    if end < 0 or lines[:1] != ["ply"]:
        raise ValueError(f"{path}: not a PLY file")
    if "format binary_little_endian 1.0" not in lines:
        raise ValueError(f"{path}: expected binary_little_endian")
    elements = []
    for line in lines:
        words = line.split()
        if words[:1] == ["element"]:
            elements.append((words[1], int(words[2]), []))
        elif words[:1] == ["property"]:
            elements[-1][2].append(words[1:])
    return elements, end + len(b"end_header\n")


def read(path):
    """Vertices as a structured array and triangles [n, 3] (none in a cloud)."""
    return parse(pathlib.Path(path).read_bytes(), path)


def parse(data, path="PLY data"):
    """As read, of a file's bytes."""
    elements, at = _header(data, path)
    vertices, faces = np.zeros(0, _CLOUD), np.zeros((0, 3), np.uint32)
    for name, count, properties in elements:
        if any(p[0] == "list" for p in properties):
            count_type, index_type = _TYPES[properties[0][1]], _TYPES[properties[0][2]]
            extra = [(p[1], "<" + _TYPES[p[0]]) for p in properties[1:]]
            row = np.dtype([("n", "<" + count_type), ("v", "<" + index_type, 3), *extra])
            table = np.frombuffer(data, row, count, at)
            if count and (table["n"] != 3).any():
                raise ValueError(f"{path}: expected triangles only")
            faces = table["v"].astype(np.uint32)
        else:
            row = np.dtype([(p[1], "<" + _TYPES[p[0]]) for p in properties])
            table = np.frombuffer(data, row, count, at)
            if name == "vertex":
                vertices = table
        at += row.itemsize * count
    return vertices, faces


def _xyz(vertices):
    return np.stack([vertices[a] for a in "xyz"], -1).astype(float).reshape(-1, 3)


def read_mesh(path):
    """Vertices [n, 3] float64 and triangles [m, 3]."""
    vertices, faces = read(path)
    return _xyz(vertices), faces


def parse_mesh(data):
    vertices, faces = parse(data)
    return _xyz(vertices), faces


def read_cloud(path):
    """Points [n, 3] float64 and labels [n]."""
    vertices, _ = read(path)
    has_labels = "label" in (vertices.dtype.names or ())
    return _xyz(vertices), vertices["label"].astype(int) if has_labels else np.zeros(len(vertices), int)


def write_cloud(path, points, labels):
    table = np.empty(len(points), _CLOUD)
    for i, axis in enumerate("xyz"):
        table[axis] = points[:, i]
    table["label"] = labels
    header = f"element vertex {len(points)}\nproperty float x\nproperty float y\nproperty float z\n"
    with open(path, "wb") as out:
        out.write(b"ply\nformat binary_little_endian 1.0\n")
        out.write((header + "property ushort label\nend_header\n").encode())
        out.write(table.tobytes())
