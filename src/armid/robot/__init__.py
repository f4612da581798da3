"""What the arm is: values, readers, built-in arms."""
