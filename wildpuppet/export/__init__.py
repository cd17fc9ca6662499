"""One file per format: meshes over time, mesh files per frame, the preview and the contact sheet."""
