"""README's snippets are files that tests run: its Python block is client/python/example.py, word for word, and every
path it names exists."""
import pathlib
import re
import sys

root = pathlib.Path(__file__).resolve().parents[2]
readme = (root / "README.md").read_text()
problems = []
if f"```python\n{(root / 'client/python/example.py').read_text()}```" not in readme:
    problems.append("the Python block differs from client/python/example.py")
if not readme.split("```sh\n", 1)[1].startswith("bash planner_demo/run.sh"):
    problems.append("README does not open with planner_demo/run.sh")
for target in re.findall(r"\]\(([^)#:]+)\)", readme):
    if not (root / target).exists():
        problems.append(f"link to {target}, which does not exist")
for path in re.findall(r"bash ((?:planner_demo|tests|docker)/\S+?\.sh)", readme):
    if not (root / path).exists():
        problems.append(f"command {path}, which does not exist")
print("\n".join(problems) or "README agrees with the tree")
sys.exit(bool(problems))
