"""Dockerfile, compose.yaml, the Kubernetes manifest and the dashboard say what they should, and only name options, metrics
and programs that exist."""
import json
import pathlib
import re
import sys
import unittest

import yaml

ROOT = pathlib.Path(__file__).resolve().parents[2]
DOCKER = ROOT / "docker"


def dockerfile_stages():
    """[(instruction, argument)] of each stage, continuation lines joined."""
    text = re.sub(r"\\\n", " ", (DOCKER / "Dockerfile").read_text())
    stages = []
    for line in text.splitlines():
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        instruction, argument = line.split(None, 1)
        if instruction == "FROM":
            stages.append([])
        stages[-1].append((instruction, argument))
    return stages


def documents(path):
    return list(yaml.safe_load_all(path.read_text()))


def config_keys():
    text = (ROOT / "server/config/config_keys.cc").read_text()
    keys = set(re.findall(r'\{"([a-z]+\.[a-z_]+)"', text))
    keys |= {f"{section}.{name}" for section, name in re.findall(r"CLEARANCE_KEY\(\w+, (\w+), (\w+)\)", text)}
    return keys | {f"map.{name}" for name in re.findall(r"CLEARANCE_MAP_KEY\(\w+, (\w+)\)", text)}


class Image(unittest.TestCase):
    def test_builds_in_one_stage_and_runs_in_another_without_root(self):
        stages = dockerfile_stages()
        self.assertEqual(len(stages), 2)
        last = dict(stages[-1])
        self.assertEqual(last["USER"], "10001:10001")
        self.assertEqual(last["VOLUME"], "/data")
        self.assertEqual(last["STOPSIGNAL"], "SIGTERM")
        self.assertIn('"clearance", "health"', last["HEALTHCHECK"])
        self.assertTrue(json.loads(last["ENTRYPOINT"])[0] == "clearance_server")
        self.assertNotIn("build", re.findall(r"install\.sh ([a-z ]+)", dict(stages[-1])["RUN"])[0].split())

    def test_the_rehearsal_takes_the_same_steps(self):
        rehearsal = (DOCKER / "rehearse.sh").read_text()
        for step in ("install.sh runtime build", "install.sh runtime", "docker/build.sh", "cmake --install /build --strip",
                     "default.yaml", "10001"):
            self.assertIn(step, rehearsal)
            self.assertIn(step, (DOCKER / "Dockerfile").read_text().replace("\\\n", ""))


class Deployment(unittest.TestCase):
    def test_compose_is_hardened_and_published_to_loopback_only(self):
        compose = documents(DOCKER / "compose.yaml")[0]
        own = [s for s in compose["services"].values() if s["image"] == "clearance"]
        self.assertGreaterEqual(len(own), 3)
        for service in own:
            self.assertTrue(service["read_only"])
            self.assertEqual(service["cap_drop"], ["ALL"])
        for name, service in compose["services"].items():
            for port in service.get("ports", []):
                self.assertTrue(port.startswith("127.0.0.1:"), (name, port))
            for dependency in service.get("depends_on", []):
                self.assertIn(dependency, compose["services"])
            for volume in service.get("volumes", []):
                source = volume.split(":")[0]
                if source.startswith("."):
                    self.assertTrue((DOCKER / source).exists(), source)
                else:
                    self.assertIn(source, compose["volumes"])

    def test_kubernetes_runs_without_rights_and_drains(self):
        sets = [d for d in documents(DOCKER / "kubernetes/clearance.yaml") if d["kind"] == "StatefulSet"]
        self.assertEqual(len(sets), 1)
        pod = sets[0]["spec"]["template"]["spec"]
        self.assertTrue(pod["securityContext"]["runAsNonRoot"])
        self.assertGreaterEqual(pod["terminationGracePeriodSeconds"], 10)
        container = pod["containers"][0]
        self.assertTrue(container["securityContext"]["readOnlyRootFilesystem"])
        for probe in ("startupProbe", "readinessProbe", "livenessProbe"):
            self.assertIn(container[probe]["httpGet"]["path"], ("/readyz", "/healthz"))
        mounts = {m["name"] for m in container["volumeMounts"]}
        volumes = {v["name"] for v in pod["volumes"]}
        volumes |= {c["metadata"]["name"] for c in sets[0]["spec"]["volumeClaimTemplates"]}
        self.assertEqual(mounts, volumes)

    def test_flags_and_keys_exist(self):
        server = (ROOT / "server/main.cc").read_text()
        keys = config_keys()
        self.assertIn("server.worker_threads", keys)
        self.assertIn("map.voxel_size_m", keys)
        texts = [(DOCKER / f).read_text() for f in ("kubernetes/clearance.yaml", "README.md", "Dockerfile", "rehearse.sh")]
        used = [key for text in texts for key in re.findall(r"--set[= ]([a-z_.]+)=", text)]
        self.assertGreater(len(used), 3)
        for key in used:
            self.assertIn(key, keys)
        flags = [f for text in texts[:1] for f in re.findall(r"- (--[a-z-]+)", text)]
        for flag in flags:
            self.assertIn(f'"{flag}"', server)

    def test_dashboard_and_scrape_name_metrics_that_the_server_serves(self):
        served = set(re.findall(r'"(clearance_[a-z0-9_]+)"', (ROOT / "server/service/http/metrics.cc").read_text()))
        dashboard = json.loads((DOCKER / "grafana/clearance.json").read_text())
        asked = {m for panel in dashboard["panels"] for target in panel["targets"]
                 for m in re.findall(r"clearance_[a-z0-9_]+", target["expr"])}
        self.assertGreater(len(asked), 8)
        self.assertEqual({m.removesuffix("_bucket") for m in asked} - served, set())
        scrape = documents(DOCKER / "prometheus/prometheus.yaml")[0]
        self.assertEqual(scrape["scrape_configs"][0]["static_configs"][0]["targets"], ["server:8080"])


if __name__ == "__main__":
    sys.exit(unittest.main())
