"""The [runtime] section of docker/packages.txt covers every library the binaries load.

    runtime_packages_test.py BINARY...

There need not be a container engine: ldd names the libraries, dpkg their packages, and the closure
of the section's dependencies must hold them all.
"""
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]


def run(*command):
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def libraries(binary):
    """Paths of the shared libraries that the loader would take; fails where one is missing."""
    if not pathlib.Path(binary).exists():
        sys.exit(f"{binary} is not built")
    paths = set()
    for line in run("ldd", binary).splitlines():
        if "not found" in line:
            sys.exit(f"{binary}: {line.strip()}")
        match = re.search(r"(/\S+) \(0x", line)
        if match:
            paths.add(match.group(1))
    return paths


def package_of(path):
    """The Debian package of a library; /lib and /usr/lib are one on a merged system."""
    real = pathlib.Path(path).resolve()
    for name in {path, str(real), str(real).removeprefix("/usr"), "/usr" + path}:
        found = subprocess.run(["dpkg", "-S", name], capture_output=True, text=True)
        if found.returncode == 0:
            return found.stdout.split(":")[0]
    return None


def installed():
    """Package -> names it provides and the alternatives of each dependency."""
    form = "${db:Status-Abbrev}\t${Package}\t${Provides}\t${Pre-Depends}, ${Depends}\n"
    packages = {}
    for line in run("dpkg-query", "-W", "-f", form).splitlines():
        status, name, provides, depends = line.split("\t")
        if not status.startswith("ii"):
            continue
        bare = [[re.sub(r"[:( ].*", "", option.strip()) for option in group.split("|")]
                for group in depends.split(",") if group.strip()]
        provided = [re.sub(r"[:( ].*", "", p.strip()) for p in provides.split(",") if p.strip()]
        packages[name] = (provided, bare)
    return packages


def closure(roots, packages):
    providers = {}
    for name, (provided, _) in packages.items():
        for virtual in [name, *provided]:
            providers.setdefault(virtual, name)
    seen, todo = set(), list(roots)
    while todo:
        name = providers.get(todo.pop())
        if name is None or name in seen:
            continue
        seen.add(name)
        for options in packages[name][1]:
            todo.append(next((o for o in options if o in providers), options[0]))
    return seen


def main():
    if len(sys.argv) < 2:
        sys.exit("name at least one binary")
    section = run("bash", str(ROOT / "docker/install.sh"), "--list", "runtime").split()
    packages = installed()
    covered, bare = closure(section, packages), closure(["libc6"], packages)
    missing = {}
    count, beyond_bare = 0, 0
    for binary in sys.argv[1:]:
        for path in sorted(libraries(binary)):
            package = package_of(path)
            count += 1
            # Libraries of the build itself belong to no package and travel with the binaries.
            if package is None and pathlib.Path(path).resolve().is_relative_to(ROOT):
                continue
            beyond_bare += package not in bare
            if package not in covered:
                missing.setdefault(package, set()).add(path)
    for package, paths in missing.items():
        print(f"docker/packages.txt [runtime] lacks {package}, needed for {', '.join(sorted(paths))}")
    if beyond_bare == 0:
        sys.exit("every library comes with libc6: the check would prove nothing")
    print(f"{count} libraries of {len(sys.argv) - 1} binaries, {len(missing)} packages missing")
    return 1 if missing else 0


if __name__ == "__main__":
    sys.exit(main())
