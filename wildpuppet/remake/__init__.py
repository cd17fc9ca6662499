"""Runs made of runs: inbetweens of two frames, and one character's motion on another's puppet."""
