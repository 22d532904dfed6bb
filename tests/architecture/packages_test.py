"""docker/install.sh reads every section of packages.txt, and refuses names it does not know."""
import pathlib
import re
import subprocess
import sys
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
INSTALL = ROOT / "docker/install.sh"


def install(*arguments):
    return subprocess.run(["bash", str(INSTALL), *arguments], capture_output=True, text=True,
                          cwd="/", stdin=subprocess.DEVNULL)


class Packages(unittest.TestCase):
    def test_every_section_lists_packages_once(self):
        listed = []
        for section in ("runtime", "build", "test", "bench"):
            names = install("--list", section).stdout.split()
            self.assertGreater(len(names), 0, section)
            listed += names
        self.assertEqual(sorted(listed), sorted(set(listed)))
        for name in listed:
            self.assertRegex(name, r"^[a-z0-9][a-z0-9+.-]+$")
        text = re.sub(r"#.*", "", (ROOT / "docker/packages.txt").read_text())
        words = [w for w in text.split() if not w.startswith("[")]
        self.assertEqual(sorted(listed), sorted(words))

    def test_an_unknown_section_is_an_error_that_names_it(self):
        result = install("--list", "nonsense")
        self.assertEqual(result.returncode, 2)
        self.assertIn("[nonsense]", result.stderr)

    def test_no_section_is_a_usage_error(self):
        self.assertEqual(install().returncode, 2)

    def test_the_image_and_the_scripts_read_the_same_list(self):
        for name in ("docker/Dockerfile", "tests/run.sh", "planner_demo/run.sh"):
            text = (ROOT / name).read_text()
            self.assertIn("docker/install.sh", text, name)
            self.assertNotRegex(text, r"apt-get\s+(-\S+\s+)*install", name)


if __name__ == "__main__":
    sys.exit(unittest.main())
