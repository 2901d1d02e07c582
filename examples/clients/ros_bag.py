"""Write joints.csv, a table of joint angles, from a ROS 2 bag (`pip install rosbags`)."""

import csv
from pathlib import Path

from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

joints = [f"joint_{i}" for i in range(1, 7)]  # names in the messages, from base to flange
types = get_typestore(Stores.ROS2_HUMBLE)
with (
    AnyReader([Path("day1_bag")], default_typestore=types) as reader,
    Path("joints.csv").open("w", newline="") as file,
):
    table = csv.writer(file)
    table.writerow(["label", *(f"J{i} [rad]" for i in range(1, 7))])
    states = reader.topics["/joint_states"].connections
    for number, (topic, _, raw) in enumerate(reader.messages(states), start=1):
        message = reader.deserialize(raw, topic.msgtype)
        position = dict(zip(message.name, message.position, strict=True))
        table.writerow([f"c{number:02}", *map(position.__getitem__, joints)])
