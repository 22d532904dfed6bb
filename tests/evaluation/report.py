#!/usr/bin/env python3
"""Writes results.json, results.md and a CSV for each table; prints README's results section from results.json:

    report.py --readme results.json
"""
import argparse
import csv
import json
import pathlib

import tables
import targets


def _markdown_table(table):
    lines = ["| " + " | ".join(table.header) + " |", "|" + "---|" * len(table.header)]
    lines += ["| " + " | ".join(row) + " |" for row in table.rows]
    return f"## {table.title}\n{table.note}\n\n" + "\n".join(lines) + "\n"


def _failures(results):
    lines = []
    for name, r in results["recordings"].items():
        lines += [f"* {name}, {what}: {error}\n" for what, error in r.get("errors", {}).items()]
    lines += [f"* {what}: {error}\n" for what, error in results.get("errors", {}).items()]
    return "## Not measured\n" + "".join(lines) + "\n" if lines else ""


def markdown(results, pictures=()):
    found = [make(results) for make in tables.ALL]
    judged = targets.judge(results)
    met = sum(j.met for j in judged)
    head = (f"# Results\n\n{len(results['recordings'])} recordings, {met} of {len(judged)} targets met. "
            f"{results.get('note', '')}\n\n")
    shown = "".join(f"![{p.stem}]({p.name})\n" for p in pictures)
    return head + _failures(results) + "\n".join(_markdown_table(t) for t in found if t.rows) + "\n" + shown


def write(results, out):
    """results.json, results.md and the CSV files; pictures that are there already are shown."""
    (out / "results.json").write_text(json.dumps(results, indent=1) + "\n")
    (out / "results.md").write_text(markdown(results, sorted(out.glob("*.png"))))
    for table in [tables.coverage(results)] + [make(results) for make in tables.ALL]:
        if table.rows:
            with open(out / f"{table.name}.csv", "w", newline="") as f:
                csv.writer(f, lineterminator="\n").writerows([table.header, *table.rows])


def _span(values, shown):
    low, high = shown(min(values)), shown(max(values))
    return low if low == high else f"{low} to {high}"


def readme(results):
    """README's accuracy table: judged values of equal meaning in one row, over all recordings."""
    rows = {}
    for j in targets.judge(results):
        scene = targets.kind(j.where.split(",")[0]) or "recordings"
        scene = "analytic scenes" if scene in targets.ANALYTIC else scene
        key = j.what if "called free" in j.what or "within 2 m" in j.what or "ghost" in j.what else \
            f"`{scene}`: {j.what}"
        rows.setdefault(key, []).append(j)
    lines = ["| what | measured | target | the paper, peers |", "|---|---|---|---|"]
    for what, group in rows.items():
        values = [j.value for j in group if j.value is not None]
        first = group[0].row()
        met = sum(j.met for j in group)
        verdict = "met" if met == len(group) else f"met by {met} of {len(group)}"
        shown = _span(values, group[0].shown) if values else "none"
        lines.append(f"| {what} | {shown} | {first[3]}: {verdict} | {first[5] or '-'} |")
    return "\n".join(lines) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--readme", type=pathlib.Path, required=True, help="results.json of a run")
    print(readme(json.loads(parser.parse_args().readme.read_text())), end="")


if __name__ == "__main__":
    main()
