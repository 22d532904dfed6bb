#!/usr/bin/env python3
"""Checks who may include whom: include_direction.py ROOT

Prints every include that points the wrong way as file:line and ends with 1 if there is one. Below
server/service nothing may know gRPC or protobuf; planner_demo talks to client/ alone.
"""
import pathlib
import re
import sys

# Folder -> folders of the project it may include besides itself. The longest matching prefix counts.
ALLOWED = {
    "proto/wire": {"server/core"},
    "server/core": set(),
    "server/config": {"server/core", "server/field", "server/map", "server/integration", "server/esdf",
                      "server/query", "server/store", "server/engine", "server/service"},
    "server/field": {"server/core"},
    "server/map": {"server/core", "server/field"},
    "server/esdf": {"server/core", "server/field", "server/map"},
    "server/integration": {"server/core", "server/field", "server/map"},
    "server/query": {"server/core", "server/field", "server/map", "server/esdf"},
    "server/store": {"server/core"},
    "server/engine": {"server/core", "server/field", "server/map", "server/esdf", "server/integration",
                      "server/query", "server/store"},
    "server/service": {"server/core", "server/field", "server/map", "server/esdf", "server/query",
                       "server/integration", "server/store", "server/engine", "server/config",
                       "proto/wire"},
    "server/main.cc": {"server/core", "server/map", "server/store", "server/engine",
                       "server/service", "server/config"},
    # The wire's own interface speaks in server/core's types (Frame, Pose, ids).
    "client": {"proto/wire", "server/core"},
    # Mirror and server must give identical numbers, so the mirror links what needs no transport.
    "client/mirror": {"client", "proto/wire", "server/core", "server/field", "server/map",
                      "server/esdf", "server/query"},
    "planner_demo": {"client", "client/mirror", "planner_demo/sim", "planner_demo/sequence"},
    "planner_demo/sim": set(),
    "planner_demo/sequence": {"planner_demo/sim"},
}
# Who may see gRPC or protobuf at all, generated headers included.
TRANSPORT_ALLOWED = ("proto/", "client/", "server/service/", "server/main.cc")
TRANSPORT = re.compile(r"^(grpc|grpcpp|google/(protobuf|rpc)|clearance/v1)/|\.pb\.h$")
INCLUDE = re.compile(r'^\s*#\s*include\s*([<"])([^>"]+)[>"]')
SOURCES = {".h", ".cc", ".inc"}
SCANNED = ("proto", "server", "client", "planner_demo")


def folder_of(path):
    """The longest key of ALLOWED that contains the path, or its own top folders."""
    matches = [k for k in ALLOWED if path == k or path.startswith(k + "/")]
    return max(matches, key=len) if matches else None


def violations(root):
    root = pathlib.Path(root)
    for top in SCANNED:
        for file in sorted((root / top).rglob("*")):
            if file.suffix not in SOURCES or not file.is_file():
                continue
            name = file.relative_to(root).as_posix()
            home = folder_of(name)
            if home is None:
                yield f"{name}: this folder has no rule in {pathlib.Path(__file__).name}"
                continue
            text = file.read_text(encoding="utf-8")
            if file.suffix == ".h" and "#pragma once" not in text:
                yield f"{name}: a header without #pragma once"
            for number, line in enumerate(text.splitlines(), 1):
                match = INCLUDE.match(line)
                if not match:
                    continue
                quote, target = match.groups()
                where = f'{name}:{number}: includes "{target}"'
                if TRANSPORT.search(target):
                    if not name.startswith(TRANSPORT_ALLOWED):
                        yield f"{where}, but only server/service and the wire may know the transport"
                    continue
                if target.split("/")[0] not in SCANNED:
                    if quote == '"' and (file.parent / target).is_file():
                        yield f"{where}, which is not named from the top of the tree"
                    continue
                owner = folder_of(target)
                if owner != home and owner not in ALLOWED[home]:
                    allowed = ", ".join(sorted(ALLOWED[home])) or "nothing else of the project"
                    yield f"{where}, but {home} may include only {allowed}"


def main():
    found = list(violations(sys.argv[1]))
    print("\n".join(found) if found else "every include points the right way")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
