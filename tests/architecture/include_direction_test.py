"""The tree obeys its include directions, and the check that says so finds what breaks them."""
import pathlib
import sys
import tempfile
import unittest

import include_direction

ROOT = pathlib.Path(__file__).resolve().parents[2]

BREACHES = {
    "server/core/a.h": '#pragma once\n#include "server/map/voxel.h"\n',
    "server/map/a.cc": '#include "server/query/query.h"\n',
    "server/query/a.cc": '#include <grpcpp/grpcpp.h>\n',
    "server/engine/a.cc": '#include "clearance/v1/query.pb.h"\n',
    "server/engine/b.cc": '#include "server/service/service.h"\n',
    "server/store/a.cc": '#include "google/protobuf/message.h"\n',
    "proto/wire/a.cc": '#include "server/map/voxel.h"\n',
    "client/a.cc": '#include "server/query/query.h"\n',
    "planner_demo/a.cc": '#include "server/core/pose.h"\n',
    "planner_demo/b.cc": '#include "clearance/v1/query.pb.h"\n',
    "planner_demo/sim/a.cc": '#include "client/client.h"\n',
    "server/field/a.h": '#include "server/core/pose.h"\n',
    "server/unheard_of/a.cc": "int x;\n",
}
FINE = {
    "server/map/a.cc": '#include "server/core/pose.h"\n#include <Eigen/Core>\n',
    "server/service/a.cc": '#include <grpcpp/grpcpp.h>\n#include "proto/wire/convert.h"\n',
    "server/main.cc": '#include "server/service/server.h"\n',
    "client/mirror/a.cc": '#include "server/query/query.h"\n',
    "client/a.cc": '#include "clearance/v1/query.grpc.pb.h"\n#include "server/core/pose.h"\n',
}


def check(files):
    with tempfile.TemporaryDirectory() as folder:
        for name, text in files.items():
            path = pathlib.Path(folder) / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        return list(include_direction.violations(folder))


class IncludeDirection(unittest.TestCase):
    def test_the_tree_obeys(self):
        self.assertEqual(list(include_direction.violations(ROOT)), [])

    def test_the_tree_is_really_read(self):
        self.assertGreater(len(list((ROOT / "server").rglob("*.cc"))), 20)

    def test_every_breach_is_found(self):
        for name, text in BREACHES.items():
            with self.subTest(name):
                found = check({name: text})
                self.assertEqual(len(found), 1, found)
                self.assertIn(name, found[0])

    def test_allowed_includes_pass(self):
        self.assertEqual(check(FINE), [])


if __name__ == "__main__":
    sys.exit(unittest.main())
