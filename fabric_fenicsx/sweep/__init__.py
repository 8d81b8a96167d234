"""Many runs of one press: values that vary, runs side by side, and what is read from them."""
