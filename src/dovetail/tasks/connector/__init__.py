"""Push a connector, held a little wrong, into its port."""
