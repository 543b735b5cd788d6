"""The live page in a browser: page.py EIT BROWSER WORK.

An emulated board plays a simulated skin that two fingers press in turn, `eit live --web` shows it, and a browser reads
the page as a person would: the table, the pixels of the drawing, the buttons, the keyboard.
"""

import os
import pathlib
import re
import signal
import subprocess
import sys
import time

from playwright.sync_api import sync_playwright

EIT, BROWSER, WORK = sys.argv[1], sys.argv[2], pathlib.Path(sys.argv[3])
SHOTS = pathlib.Path(os.environ.get("PAGE_SHOTS", WORK / "shots"))
# largest distance of a shown touch from where the emulator presses; the skin's radius is 100 mm
WITHIN_MM = 6
# largest distance of the drawn circle from the position in the table, in pixels of the page
WITHIN_PX = 3
# the fingers press at these places, one after the other
PRESSES_MM = [(40, 25), (-50, -10)]
FIRST_S, PRESS_S, PAUSE_S = 4.6, 3.0, 1.0
RATE_HZ = 30
# added to the built-in scene, for which there is a trained net
STAGES = """
[reconstruction]
method = "st-tv"
target_gap = 0.1
[touch]
drift_time_s = 300.0
[denoise]
weights = "default"
[instrument]
driver = "eits1"
frame_rate_hz = %d
""" % RATE_HZ


def script():
    """Two presses, with quiet frames before for the reference. Its ten frames a second are played faster."""
    end_s = FIRST_S + len(PRESSES_MM) * (PRESS_S + PAUSE_S)
    text = f'name = "presses"\nframe_rate_hz = 10.0\nframes = {int(10 * end_s)}\nquiet_frames = 44\n'
    for number, (x, y) in enumerate(PRESSES_MM):
        start = FIRST_S + number * (PRESS_S + PAUSE_S)
        text += f"[[finger]]\nid = {number + 1}\n"
        for at, force in [(0, 0), (0.2, 1.5), (PRESS_S - 0.2, 1.5), (PRESS_S, 0)]:
            text += "[[finger.key]]\n"
            text += f"time_s = {start + at}\nposition_m = [{x / 1e3}, {y / 1e3}]\nforce_n = {force:.1f}\nradius_m = 0.01\n"
    return text


def run(*arguments):
    subprocess.run([EIT, *map(str, arguments)], check=True, stdout=subprocess.DEVNULL)


class Program:
    """A command that serves a page, and is ended as by Ctrl-C."""

    def __init__(self, *arguments):
        arguments = [EIT, *map(str, arguments)]
        self.process = subprocess.Popen(arguments, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)

    def address(self):
        for line in self.process.stderr:
            if found := re.search(r"http://\S+", line):
                return found[0]
        raise AssertionError("no address was printed")

    def end(self):
        self.process.send_signal(signal.SIGINT)
        self.process.stderr.read()
        return self.process.wait(20)


class Page:
    def __init__(self, context, address, errors):
        self.page = context.new_page()
        self.page.on("console", lambda said: errors.append(said.text) if said.type == "error" else None)
        self.page.on("pageerror", lambda error: errors.append(str(error)))
        self.page.on("request", lambda asked: errors.append(asked.url) if not asked.url.startswith(address.split("?")[0]) else None)
        self.page.goto(address)

    def text(self, place):
        return self.page.text_content("#" + place).strip()

    def wait(self, what, limit_s=30):
        """Waits for an expression of the page to hold."""
        end = time.monotonic() + limit_s
        while not self.page.evaluate(what):
            assert time.monotonic() < end, f"never: {what}; the page shows: {self.page.inner_text('body')}"
            self.page.wait_for_timeout(20)

    def wait_for_touch(self):
        self.wait("document.getElementById('verdict').textContent === '1 touch'")

    def wait_for_no_touch(self):
        self.wait("document.getElementById('verdict').textContent === 'No touch.'")

    def position_mm(self):
        cells = self.page.eval_on_selector_all("#touches td", "all => all.map(cell => cell.textContent)")
        return (float(cells[1]), float(cells[2])) if len(cells) == 5 else None

    def next_press_mm(self):
        """Where the next press is, some time after its soft beginning. A busy computer may look after its end: then the
        press after it counts."""
        for _ in range(5):
            self.wait_for_no_touch()
            self.wait_for_touch()
            self.page.wait_for_timeout(400)
            if found := self.position_mm():
                return found
        raise AssertionError("no press lasted until it was read")

    def drawn(self):
        """Drawn skin as a string, to see whether it changes."""
        return self.page.evaluate("document.querySelector('#main canvas').toDataURL()")

    def circle_px(self):
        """Middle of the pixels in the colour of a touch, and where the position in the table should be drawn."""
        return self.page.evaluate(
            """() => {
            const canvas = document.querySelector('#main canvas'), pen = canvas.getContext('2d');
            const cells = [...document.querySelectorAll('#touches td')].map(cell => cell.textContent);
            const wanted = touchColor(parseInt(cells[0])).match(/[0-9a-f]{2}/g).map(part => parseInt(part, 16));
            const { data, width } = pen.getImageData(0, 0, canvas.width, canvas.height);
            let low = [1e9, 1e9], high = [-1, -1];
            for (let i = 0; i < data.length; i += 4) if (wanted.every((part, k) => Math.abs(data[i + k] - part) < 3)) {
                const at = [i / 4 % width, Math.floor(i / 4 / width)];
                low = low.map((v, k) => Math.min(v, at[k])); high = high.map((v, k) => Math.max(v, at[k]));
            }
            // the disc has a radius of 100 mm, with a margin of 8 % of its width
            const mm = width / 232;
            return { found: low.map((v, k) => (v + high[k]) / 2), table: [(116 + +cells[1]) * mm, (116 - +cells[2]) * mm] };
        }"""
        )

    def shot(self, name):
        if "PAGE_SHOTS" in os.environ:
            SHOTS.mkdir(exist_ok=True)
            self.page.screenshot(path=SHOTS / f"{name}.png", full_page=True)

    def check_width(self, width):
        wide = self.page.evaluate("document.documentElement.scrollWidth")
        assert wide <= width, f"{wide} px at a width of {width}"


def near(found, wanted, within, what):
    distance = sum((a - b) ** 2 for a, b in zip(found, wanted)) ** 0.5
    assert distance <= within, f"{what}: {found} instead of {wanted}"
    return distance


def touches(page):
    """Each press appears where the emulator presses, after a moment without any touch."""
    worst = 0
    for press in PRESSES_MM:
        # the other press may be the next, if the page opened between them
        found = page.next_press_mm()
        wanted = min(PRESSES_MM, key=lambda place: (place[0] - found[0]) ** 2 + (place[1] - found[1]) ** 2)
        worst = max(worst, near(found, wanted, WITHIN_MM, "touch in the table, mm"))
    place = page.circle_px()
    near(place["found"], place["table"], WITHIN_PX * 2, "circle of the touch, px")
    assert page.text("electrodes") == "All 16 electrodes work."
    rate = float(page.text("rate"))
    # a busy computer may delay frames; a page that takes another number for the rate is far off
    assert 0.5 * RATE_HZ < rate < 1.5 * RATE_HZ, f"{rate} frames a second"
    assert page.page.is_visible("#before canvas"), "no image before the net"
    return worst


def pause_and_scrub(page):
    page.next_press_mm()
    page.page.keyboard.press("Space")
    page.wait("document.getElementById('when').textContent.startsWith('paused: ')")
    page.page.wait_for_timeout(200)
    before, place = page.drawn(), page.position_mm()
    page.page.wait_for_timeout(1200)
    assert (page.drawn(), page.position_mm()) == (before, place), "the picture goes on after a pause"
    # back to before this touch, by the keyboard
    page.page.focus("#scrub")
    for _ in range(40):
        page.page.keyboard.press("ArrowLeft")
        page.page.wait_for_timeout(30)
        if page.text("verdict") == "No touch.":
            break
    page.wait_for_no_touch()
    assert page.text("when").endswith(" s ago") and page.drawn() != before, "scrubbing does not show the past"
    page.page.click("#pause")
    page.wait("document.getElementById('when').textContent === 'live'")


def faults_and_forces(page):
    """What the emulator does not have: a frame with a faulty electrode, an uncertain touch and forces."""
    page.page.evaluate(
        """() => {
        events.onmessage = null;
        events.close();
        const line = structuredClone(past.frames.findLast(frame => frame.line.touches.length).line);
        const touch = { ...line.touches[0], state: "hold", force_n: 1.25, force_std_n: 0.1, position_m: [0.02, 0.03, 0] };
        line.touches = [touch, { ...touch, id: touch.id + 1, valid: false, position_m: [-0.04, -0.02, 0] }];
        line.faulty_electrodes = [{ electrode: 3, fault: "contradicts", since_s: 1 }];
        take(line);
    }"""
    )
    page.wait("document.getElementById('verdict').textContent === '1 touch, 1 uncertain'")
    said = page.text("electrodes")
    assert said.startswith("Left out: electrode 3 (its voltages contradict the others)"), said
    assert page.text("strength") == "force, N" and page.text("chart-name") == "force, N"
    cells = page.page.eval_on_selector_all("#touches td", "all => all.map(cell => cell.textContent)")
    assert cells[4] == "1.25 ± 0.10" and cells[5].endswith("?"), cells
    assert page.page.is_visible("#unsure") and page.page.is_visible("#out")
    page.shot("faults")
    page.page.evaluate("take({ ...past.frames.at(-1).line, state: 'frozen', touches: [] })")
    page.wait("document.getElementById('verdict').textContent === 'Not known: the instrument repeats an old frame'")
    assert not page.page.is_visible("#none"), "says that nothing touches the skin"
    page.shot("frozen")


def silent(page, emulator):
    """An instrument that stops is told in large letters, and the page goes on when it does."""
    page.wait_for_touch()
    emulator.send_signal(signal.SIGSTOP)
    try:
        page.wait("document.getElementById('verdict').textContent === 'No signal'")
        page.wait("document.getElementById('state').className === 'bad'")
        page.shot("silent")
    finally:
        emulator.send_signal(signal.SIGCONT)
    page.wait("document.getElementById('verdict').textContent !== 'No signal'")


def record(page):
    page.page.click("#record")
    page.wait("document.getElementById('recording').textContent.startsWith('Recording to ')")
    page.page.wait_for_timeout(2500)
    page.page.click("#record")
    page.wait("document.getElementById('recording').textContent.startsWith('Recorded: ')")
    file = pathlib.Path(page.text("recording").removeprefix("Recorded: "))
    assert file.parent == WORK and file.suffix == ".mcap", file
    table = WORK / "recorded.csv"
    run("convert", file, "--out", table)
    rows = sum(1 for line in table.open() if not line.startswith("#"))
    assert rows > RATE_HZ, f"{rows} frames recorded"
    return file


def check(browser):
    errors = []
    skin = subprocess.run([EIT, "plan", "paper-disc", "--print-scene"], check=True, capture_output=True, text=True)
    (WORK / "board.toml").write_text(skin.stdout + STAGES)
    (WORK / "presses.toml").write_text(script())
    run("simulate", WORK / "board.toml", "--script", WORK / "presses.toml", "--nodes", 2500, "--out", WORK / "pressed")
    port = WORK / "skin"
    emulator = subprocess.Popen(
        [EIT, "emulate", WORK / "board.toml", "--port", port, "--frames", WORK / "pressed" / "frames.npy"],
        stdout=subprocess.DEVNULL,
    )
    while not port.exists():
        assert emulator.poll() is None, "the emulator has ended"
        time.sleep(0.02)
    live = Program("live", WORK / "board.toml", "--port", port, "--web=127.0.0.1:0")
    try:
        address = live.address()
        context = browser.new_context(viewport={"width": 1280, "height": 1000}, color_scheme="light")
        page = Page(context, address, errors)
        worst = touches(page)
        pause_and_scrub(page)
        file = record(page)
        for width, height in [(1280, 1000), (390, 844)]:
            for scheme in ["light", "dark"]:
                page.page.set_viewport_size({"width": width, "height": height})
                page.page.emulate_media(color_scheme=scheme)
                page.wait_for_no_touch()
                page.shot(f"{width}-{scheme}-untouched")
                page.wait_for_touch()
                page.page.wait_for_timeout(400)
                page.check_width(width)
                page.shot(f"{width}-{scheme}")
        silent(page, emulator)
        # without the token the page shows everything, and records nothing
        without = Page(context, address.split("?")[0], errors)
        without.wait("document.getElementById('record').disabled && !document.getElementById('record').hidden")
        without.wait_for_touch()
        faults_and_forces(without)
        assert not errors, errors
        context.close()
    finally:
        live.end()
        emulator.terminate()
        emulator.wait()
    replayed(browser, file)
    return worst


def replayed(browser, file):
    """A recording on the page: no button to record."""
    replay = Program("replay", WORK / "board.toml", "--from", file, "--reference-frames", 10, "--speed", "0.3", "--web=127.0.0.1:0")
    try:
        errors = []
        page = Page(browser.new_context(), replay.address(), errors)
        page.wait("document.getElementById('latency').textContent === 'replay'")
        page.wait("document.getElementById('when').textContent === 'recording'")
        assert page.text("state").startswith("Recording: ")
        assert page.page.is_hidden("#record") and not errors, errors
        page.page.close()
    finally:
        replay.end()


def main():
    with sync_playwright() as start:
        browser = start.chromium.launch(executable_path=BROWSER, args=["--no-sandbox", "--disable-gpu"])
        worst = check(browser)
        browser.close()
    print(f"the live page: touches within {worst:.1f} mm, 1280 and 390 px, light and dark, pause, scrub, record, replay")


main()
