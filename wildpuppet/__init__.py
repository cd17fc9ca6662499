"""wildpuppet: layered puppets from cartoon clips (Neural Puppet, WACV 2020, carried to a product)."""
