"""What a run makes: frames, products, their inputs and states."""
