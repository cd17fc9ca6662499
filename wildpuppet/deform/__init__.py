"""The deformation network of Neural Puppet: from a picture to a pose, and its training on the clip."""
