"""Draws the pictures of docs/viewer.md: a cut around a nerve and a vessel, as the page shows it.

``python docs/draw.py viewer viewer_arm viewer_found viewer_shield`` calls it.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
from playwright.sync_api import sync_playwright
from scipy.spatial.transform import Rotation
from test_viewer_browser import ARGUMENTS, CHROMIUM, Tab, fill, open_tab, settle

import noslip as ns
from noslip.cli.simulate import run as simulate
from noslip.viewer import Page, read_simulation
from waiting import until

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("--out", default="viewer.png", help="the picture's file")
parser.add_argument(
    "--of",
    default="cut",
    help="cut; arm, which executes it; shield, around it; or a recording, and what holds in it",
)
given = parser.parse_args()

# A straight cut of 10 cm in 4 s, demonstrated before either was known of; the hand wavers.
s = np.linspace(0, 1, 501)
u = s**3 * (10 - 15 * s + 6 * s**2)
path = np.column_stack([0.1 * u, 0.002 * np.sin(6 * np.pi * u), 0 * u])
hand = ns.PoseTrajectory(4 * s, path, Rotation.identity(len(s)), name="demonstration.csv")
rules = [
    ns.KeepOutSphere(center=(0.03, -0.004, 0.0), radius=0.012),
    ns.constraints.KeepOutCapsule(start=(0.06, 0.008, 0.0), end=(0.08, 0.03, 0.0), radius=0.01),
    ns.Blade(),
    ns.constraints.PlaneContact(),
]
dmp = ns.learn(hand, rules)

shown: dict = {"excision.json": dmp, "demonstration.csv": hand}
if given.of == "arm":
    with tempfile.TemporaryDirectory() as folder:
        # Once around the nerve alone: no arm turns as fast as that waver asks for.
        path = np.column_stack([0.1 * u, 0.02 * np.sin(np.pi * u), 0 * u])
        bent = ns.PoseTrajectory(4 * s, path, Rotation.from_euler("z", 0.4 * np.cos(np.pi * s)))
        nerve = ns.KeepOutSphere(center=(0.05, 0.0, 0.0), radius=0.012)
        primitive = ns.learn(bent, [nerve, *rules[2:]]).save(f"{folder}/excision.json")
        arm = Path(folder) / "arm"
        simulate(
            primitive,
            out=arm,
            placement="0.5,0,0.2,0.5",
            dynamics="impedance",
            noise=True,
            model_error=0.05,
        )
        shown = {"arm": read_simulation(arm)}
elif given.of.endswith(".csv"):
    (recording,) = ns.load_demonstrations(given.of)
    shown = {Path(given.of).name: recording}
elif given.of == "shield":
    del shown["demonstration.csv"]
page = Page(shown, port=0)
with sync_playwright() as p:
    browser = p.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
    tab = Tab(browser, width=1280, height=800, sharpness=1.0)
    tab.open(f"{page.address}/")
    settle(page)
    if given.of in ("cut", "arm"):
        fill(tab, "Time (s)", "1.7")
        tab.view.get_by_text("1.700 s" if given.of == "arm" else "1.696 s").wait_for()
    else:
        open_tab(tab, "Hold")
    if given.of.endswith(".csv"):
        tab.view.get_by_text("What holds?", exact=True).click()
        tab.view.get_by_text("Orange: axes free of slip").wait_for()
        fill(tab, "Time (s)", "2.5")
        until(lambda: page.time == 2.5, "the time that was typed")
        # Near enough for the regions to be seen.
        (client,) = page.server.get_clients().values()
        tool = page.drawing.tool_pose(page.chosen)[0]
        client.camera.position = tool + page.drawing.size * np.array([0.0, -0.3, 0.6])
        client.camera.look_at = tool + page.drawing.size * np.array([0.1, 0.0, 0.0])
    if given.of == "shield":
        fill(tab, "Time (s)", "2.2")
        tab.view.get_by_text("Drag a command", exact=True).click()
        until(lambda: page.shields.run, "the run")
        begun = np.array(page.shields.command.position)
        for share in np.linspace(0, 1, 100):
            page.shields.command.position = begun + share * np.array([0.03, -0.03, 0.0])
            tab.view.wait_for_timeout(30)
    # What is drawn in software comes later than the text.
    if given.of != "shield":
        tab.view.wait_for_timeout(3000)
    tab.view.screenshot(path=given.out)
    browser.close()
page.stop()
