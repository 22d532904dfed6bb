#!/usr/bin/env python3
"""Draws the drives that clearance_planner_demo --out leaves: drive_pictures.py OUT

contact_sheet.png: each row of the table at four moments of one crossing; drive.gif: the first row's
drive; both seen from above: the map's slice, its objects with their predicted way, the plan.
"""
import json
import math
import pathlib
import sys

import numpy as np
from matplotlib import font_manager
from PIL import Image, ImageDraw, ImageFont

SCALE = 2  # drawn so much larger, then smoothed
TITLES = {"clearance": "Clearance: map and prediction", "frozen_snapshot": "Frozen snapshot",
          "static_fusion": "Static fusion", "straight_ahead": "Straight ahead, blind"}
INK, FAINT, PAPER = (32, 36, 44), (120, 126, 138), (250, 250, 248)
PLAN, UNSAFE, OBJECT, TRUE, ROBOT = (16, 132, 92), (208, 40, 60), (214, 106, 22), (118, 52, 150), (12, 92, 190)
PREDICT_S = 2.0


def font(size):
    return ImageFont.truetype(font_manager.findfont("DejaVu Sans"), int(size * SCALE))


def mix(a, b, t):
    return tuple(int(round(x + (y - x) * t)) for x, y in zip(a, b))


class View:
    """A square map with y up; coordinates in metres."""

    def __init__(self, drive, pixels):
        low, high = np.array(drive["min"][:2]) - 6.5, np.array(drive["max"][:2]) + 6.5
        half = max(high - low) / 2
        centre = (low + high) / 2
        self.low, self.high = centre - half, centre + half
        self.size = pixels * SCALE
        self.per_m = self.size / (2 * half)
        self.image = Image.new("RGB", (self.size, self.size), PAPER)
        self.draw = ImageDraw.Draw(self.image, "RGBA")

    def at(self, x, y):
        return ((x - self.low[0]) * self.per_m, (self.high[1] - y) * self.per_m)

    def slice(self, path):
        """Free space by its clearance, surfaces dark, what nobody saw hatched grey."""
        data = path.read_bytes()
        end = data.index(b"\n") + 1
        columns, rows, x0, y0, step = data[:end].split()
        columns, rows = int(columns), int(rows)
        cells = np.frombuffer(data, np.uint8, offset=end).reshape(2, rows, columns)
        distance, state = cells[0] / 100.0, cells[1]
        t = np.clip(distance / 1.6, 0, 1)[..., None]
        picture = (1 - t) * np.array((196, 216, 232)) + t * np.array((248, 250, 251))
        picture[state == 0] = (222, 222, 220)
        picture[state == 2] = (74, 80, 94)
        picture = Image.fromarray(picture[::-1].astype(np.uint8))
        left, top = self.at(float(x0) - float(step) / 2, float(y0) + (rows - .5) * float(step))
        width, height = columns * float(step) * self.per_m, rows * float(step) * self.per_m
        self.image.paste(picture.resize((round(width), round(height)), Image.BICUBIC),
                         (round(left), round(top)))
        self.draw = ImageDraw.Draw(self.image, "RGBA")

    def box(self, thing, fill=None, outline=None, width=1.5, shift=(0, 0, 0)):
        c, s = math.cos(thing["yaw"] + shift[2]), math.sin(thing["yaw"] + shift[2])
        l, w = thing["size"][0] / 2, thing["size"][1] / 2
        x, y = thing["center"][0] + shift[0], thing["center"][1] + shift[1]
        corners = [self.at(x + c * a - s * b, y + s * a + c * b)
                   for a, b in ((l, w), (l, -w), (-l, -w), (-l, w))]
        self.draw.polygon(corners, fill=fill)
        if outline:
            self.draw.line(corners + corners[:1], fill=outline, width=round(width * SCALE),
                           joint="curve")

    def predicted(self, thing):
        """Where the map expects the object, along its screw motion."""
        vx, vy = thing["velocity"][:2]
        rate = thing["yaw_rate"]
        if math.hypot(vx, vy) < 0.3:
            return
        steps = 4
        for k in range(steps, 0, -1):
            t = PREDICT_S * k / steps
            a = rate * t
            p = np.array(thing["center"][:2]) - np.array(thing["origin"][:2])
            turned = np.array([math.cos(a) * p[0] - math.sin(a) * p[1],
                               math.sin(a) * p[0] + math.cos(a) * p[1]])
            if abs(rate) < 1e-3:
                moved = np.array([vx, vy]) * t
            else:
                moved = np.array([math.sin(a) * vx - (1 - math.cos(a)) * vy,
                                  (1 - math.cos(a)) * vx + math.sin(a) * vy]) / rate
            shift = moved + turned - p
            self.box(thing, fill=OBJECT + (round(70 - 45 * k / steps),), shift=(*shift, a))

    def disc(self, x, y, radius_m, fill, outline=None, width=1.5):
        cx, cy = self.at(x, y)
        r = radius_m * self.per_m
        self.draw.ellipse((cx - r, cy - r, cx + r, cy + r), fill=fill, outline=outline,
                          width=round(width * SCALE))

    def line(self, points, colour, width):
        if len(points) > 1:
            self.draw.line([self.at(*p[:2]) for p in points], fill=colour,
                           width=round(width * SCALE), joint="curve")

    def text(self, x, y, words, size=10, colour=INK, anchor="la"):
        """At pixels from the top left corner."""
        self.draw.text((x * SCALE, y * SCALE), words, font=font(size), fill=colour, anchor=anchor)

    def done(self):
        return self.image.resize((self.size // SCALE, self.size // SCALE), Image.LANCZOS)


class Drive:
    def __init__(self, folder):
        self.folder = folder
        self.about = json.loads((folder / "drive.json").read_text())
        self.moments = [json.loads(line) for line in (folder / "moments.jsonl").open()]

    def draw(self, index, pixels, title=None, slice_from=None):
        """The moment, with the newest slice and objects there were by then."""
        view = View(self.about, pixels)
        moment = self.moments[index]
        known = next((m for m in reversed(self.moments[:index + 1]) if "objects" in m), None)
        newest = moment["frame"] if known is None else known["frame"]
        source = self.folder if slice_from is None else slice_from
        slices = [p for p in source.glob("slice_*.u8")]
        slices = sorted((abs(int(p.stem[6:]) - newest), p) for p in slices)
        if slices:
            view.slice(slices[0][1])
        objects = known["objects"] if known else []
        late_s = moment["time_s"] - known["time_s"] if known else 0
        for thing in objects:
            view.predicted(thing)
        for thing in moment.get("truth", []):
            view.box(thing, fill=TRUE + (40,), outline=TRUE + (200,), width=1)
        for thing in objects:
            move = (thing["velocity"][0] * late_s, thing["velocity"][1] * late_s,
                    thing["yaw_rate"] * late_s)
            view.box(thing, fill=OBJECT + (150,), outline=OBJECT, width=1.4, shift=move)
        start, goal = self.about["start"], self.about["goal"]
        view.disc(goal[0], goal[1], 0.9, None, ROBOT, 1.6)
        view.disc(goal[0], goal[1], 0.3, ROBOT)
        view.disc(start[0], start[1], 0.25, FAINT)
        view.line([m["robot"] for m in self.moments[:index + 1]], ROBOT + (150,), 2.2)
        cycle = next((m["cycle"] for m in reversed(self.moments[:index + 1]) if "cycle" in m), None)
        safe = cycle is None or cycle["safe"]
        plan = [p for p in moment["plan"] if p[3] >= moment["time_s"] - 1e-6]
        view.line(plan, (PLAN if safe else UNSAFE) + (230,), 2.6)
        for p in plan[::5]:
            view.disc(p[0], p[1], 0.16, PLAN if safe else UNSAFE)
        x, y = moment["robot"][:2]
        crashed = self.about["collides"] and index == len(self.moments) - 1
        if crashed:
            view.disc(x, y, 1.5, UNSAFE + (90,), UNSAFE, 2)
        view.disc(x, y, self.about["radius"], ROBOT, (255, 255, 255), 1.2)
        tip = (x + 0.8 * math.cos(moment["heading"]), y + 0.8 * math.sin(moment["heading"]))
        view.line([(x, y), tip], (255, 255, 255), 1.4)
        # A scale of 5 m.
        left, base = view.size - 14 * SCALE - 5 * view.per_m, view.size - 12 * SCALE
        view.draw.line((left, base, left + 5 * view.per_m, base), fill=INK, width=2 * SCALE)
        view.text((left / SCALE), base / SCALE - 14, "5 m", 9)
        label = f"{moment['time_s']:.1f} s   {moment['speed']:.1f} m/s"
        if self.about["flies"]:
            label += f"   {moment['robot'][2]:.1f} m up"
        plate(view, 6, 6, ([title] if title else []) + [label])
        if crashed:
            plate(view, 6, pixels - 30, ["collision"], UNSAFE)
        return view.done()


def plate(view, x, y, lines, colour=INK):
    width = max(font(10).getlength(line) for line in lines) / SCALE + 10
    view.draw.rectangle((x * SCALE, y * SCALE, (x + width) * SCALE, (y + 4 + 15 * len(lines)) * SCALE),
                        fill=(255, 255, 255, 215))
    for i, line in enumerate(lines):
        view.text(x + 5, y + 3 + 15 * i, line, 10, colour)


def legend(width):
    """As many lines as it takes."""
    line, gap = 18 * SCALE, 14 * SCALE
    image = Image.new("RGB", (width * SCALE, 8 * line), PAPER)
    draw = ImageDraw.Draw(image, "RGBA")
    x, y = 10 * SCALE, 4 * SCALE
    for colour, words in ((ROBOT, "robot and its way"), (PLAN, "plan, a dot a second"),
                          (UNSAFE, "plan that cannot be safe"),
                          (OBJECT, "object in the map, and the next 2 s of it"), (TRUE, "true outline"),
                          ((74, 80, 94), "surface"), ((222, 222, 220), "never seen")):
        length = 15 * SCALE + font(9.5).getlength(words)
        if x + length > image.width:
            x, y = 10 * SCALE, y + line
        draw.rectangle((x, y + 4 * SCALE, x + 10 * SCALE, y + 14 * SCALE), fill=colour)
        draw.text((x + 15 * SCALE, y + line / 2), words, font=font(9.5), fill=INK, anchor="lm")
        x += length + gap
    image = image.crop((0, 0, image.width, y + line + 4 * SCALE))
    return image.resize((width, image.height // SCALE), Image.LANCZOS)


def under(picture, more):
    image = Image.new("RGB", (picture.width, picture.height + more.height), PAPER)
    image.paste(picture, (0, 0))
    image.paste(more, (0, picture.height))
    return image


def sheet(drives, path, pixels=330, shots=4):
    """One row a drive; moments spread from start to end."""
    band = 24
    width, height = pixels * shots, (pixels + band) * len(drives)
    image = Image.new("RGB", (width, height), PAPER)
    for row, drive in enumerate(drives):
        top = row * (pixels + band)
        title = Image.new("RGB", (width * SCALE, band * SCALE), PAPER)
        outcome = drive.about["outcome"]
        ImageDraw.Draw(title).text((8 * SCALE, band * SCALE / 2),
                                   f"{TITLES[drive.about['row']]}: {outcome}", font=font(11),
                                   fill=UNSAFE if drive.about["collides"] else INK, anchor="lm")
        image.paste(title.resize((width, band), Image.LANCZOS), (0, top))
        last = len(drive.moments) - 1
        first = min(8, last)
        for k in range(shots):
            index = round(first + (last - first) * k / (shots - 1))
            shot = drive.draw(index, pixels - 2, slice_from=drives[0].folder
                              if drive.about["row"] == "straight_ahead" else None)
            image.paste(shot, (k * pixels, top + band))
    under(image, legend(width)).save(path)


def colours_of(frame):
    """The frame beside swatches of what is small in it, so that a palette keeps those, too."""
    keys = (INK, ROBOT, PLAN, UNSAFE, OBJECT, TRUE, FAINT)
    pairs = [mix(key, paper, t) for key in keys for paper in ((196, 216, 232), (255, 255, 255))
             for t in (0, .35, .7)]
    side = frame.height // len(pairs)
    image = under(frame, Image.new("RGB", (frame.width, 1), PAPER))
    wide = Image.new("RGB", (frame.width + 12 * side, image.height), PAPER)
    wide.paste(image, (0, 0))
    for i, colour in enumerate(pairs):
        wide.paste(colour, (frame.width, i * side, wide.width, (i + 1) * side))
    return wide


def film(drive, path, pixels=520, every=2):
    frames = [drive.draw(i, pixels, TITLES[drive.about["row"]])
              for i in range(0, len(drive.moments), every)]
    frames += [drive.draw(len(drive.moments) - 1, pixels, drive.about["outcome"])]
    frames = [under(frame, legend(pixels)) for frame in frames]
    palette = colours_of(frames[len(frames) // 2]).quantize(255)
    frames = [f.quantize(palette=palette, dither=Image.NONE) for f in frames]
    times = [round(100 * every * 0.8)] * (len(frames) - 1) + [2500]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=times, loop=0,
                   optimize=True)


def main():
    out = pathlib.Path(sys.argv[1])
    drives = [Drive(out / row) for row in TITLES if (out / row / "drive.json").exists()]
    sheet(drives, out / "contact_sheet.png")
    film(drives[0], out / "drive.gif")


if __name__ == "__main__":
    main()
