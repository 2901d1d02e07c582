"""Attacks and faults: hostile clients, broken disks, dying processes."""
