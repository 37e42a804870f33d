"""``noslip topics``: what is inside a bag.

noslip topics run.bag

noslip topics run_bag/ --json
"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table
from rich.text import Text

from noslip.cli import options, output
from noslip.errors import one_line
from noslip.recordings.bags import bag_topics
from noslip.recordings.transforms import links_text


def run(
    bag: Annotated[
        Path,
        typer.Argument(
            help="A ROS 1 bag, the folder of a ROS 2 bag, or an MCAP file.", show_default=False
        ),
    ],
    as_json: options.AsJson = False,
) -> None:
    """Show the topics of a bag: types, counts, frames of poses, and publishers if several."""
    topics = bag_topics(bag)
    if as_json:
        output.print_json([asdict(topic) for topic in topics])
        return
    names = ["topic", "type", "messages", "frames"]
    # One publisher is of no interest, and has no name but in ROS 1.
    if any(len(topic.publishers) > 1 for topic in topics):
        names.append("publishers")
    table = Table(*names, box=None, pad_edge=False)
    for topic in topics:
        frames, publishers = links_text(topic.frames), ", ".join(topic.publishers)
        kind = topic.type.replace("/msg/", "/")
        row = (topic.name, kind, topic.messages, frames, publishers)[: len(names)]
        # As text: brackets are no markup.
        table.add_row(*(Text(one_line(x)) for x in row))
    output.console().print(table)
