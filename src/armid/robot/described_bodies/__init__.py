"""Bodies of a description before fixed joints are merged: stated inertia and shapes, in the frame of each body."""
