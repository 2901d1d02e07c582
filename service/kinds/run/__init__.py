"""Identification of joint stiffnesses from one measurement set."""
