"""The appearance of the drawings: from the rendered puppet to the drawn frame (Neural Puppet, section 3.3)."""
