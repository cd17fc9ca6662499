"""The application: the command line and one short file per command that puts stages in order."""
