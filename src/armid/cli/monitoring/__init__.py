"""Commands about external torque."""
