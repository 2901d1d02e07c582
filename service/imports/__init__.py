"""Files → plain tables → a mapping that the robot proposes and a person edits → readings."""
