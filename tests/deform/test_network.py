import torch

from wildpuppet.deform.network import DeformationNetwork, shrink

torch.set_num_threads(1)
BASE = torch.tensor([[0.0, 0.5], [-0.5, 0.0], [0.25, 0.25]])


def network(code_relu: bool = True, pixels: int = 64) -> DeformationNetwork:
    return DeformationNetwork(BASE, 512, code_relu, pixels, torch.Generator().manual_seed(0))


def test_layers_are_the_papers():
    shapes = {name: tuple(values.shape) for name, values in network().named_parameters() if name.endswith("weight")}
    assert shapes == {
        "convolutions.0.weight": (64, 3, 5, 5),
        "convolutions.1.weight": (128, 64, 5, 5),
        "convolutions.2.weight": (256, 128, 5, 5),
        "to_code.0.weight": (1024, 256 * 8 * 8),
        "to_code.1.weight": (1024, 1024),
        "to_code.2.weight": (512, 1024),
        "from_code.0.weight": (1024, 512),
        "from_code.1.weight": (2048, 1024),
        "to_offsets.weight": (6, 2048),
        "to_bias.weight": (2, 2048),
    }


def test_untrained_network_answers_the_rest_pose():
    pictures = torch.rand(2, 3, 18, 18, generator=torch.Generator().manual_seed(1))
    torch.testing.assert_close(network(pixels=18)(pictures), BASE.expand(2, 3, 2))


def test_bias_moves_every_vertex_alike():
    net, codes = network(pixels=18), torch.ones(1, 512)
    with torch.no_grad():
        net.to_bias.bias.copy_(torch.tensor([0.1, -0.2]))
    torch.testing.assert_close(net.decode(codes)[0], BASE + torch.tensor([0.1, -0.2]))


def test_code_is_two_sided_without_the_relu():
    pictures = torch.rand(4, 3, 18, 18, generator=torch.Generator().manual_seed(1))
    assert network(code_relu=True, pixels=18).encode(pictures).min() >= 0
    codes = network(code_relu=False, pixels=18).encode(pictures)
    assert codes.min() < 0 < codes.max()


def test_pictures_shrink_without_being_stretched():
    wide = torch.full((1, 40, 80, 3), 255, dtype=torch.uint8)
    small = shrink(wide, 20)
    assert small.shape == (1, 3, 20, 20)
    torch.testing.assert_close(small[0, 0, :, 10], torch.tensor([0.0] * 5 + [1.0] * 10 + [0.0] * 5))
