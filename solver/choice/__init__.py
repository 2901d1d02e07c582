"""Choice of the elastic model, its loss and its penalty by prediction of held-out postures."""
