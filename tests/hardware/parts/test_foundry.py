"""The level of a foundry's transistors, as parts see it."""

from ann_dc.hardware.parts.foundry import SKY130, passive


def test_what_its_models_draw_is_not_drawn_twice():
    drawn = passive(SKY130.tolerances)
    assert drawn.offset == drawn.gain == drawn.product_offset == 0.0
    assert drawn.resistor == SKY130.tolerances.resistor > 0
    assert drawn.capacitor == SKY130.tolerances.capacitor > 0


def test_it_is_emulated_and_has_no_parameters_of_macro_models():
    assert SKY130.emulated
    assert SKY130.parameters == {}
