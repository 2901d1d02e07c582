"""The numerical core: from kinematics and readings to certified joint compliances. No I/O, no messages."""
