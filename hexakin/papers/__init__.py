"""What the notebooks of the two papers need: scenarios, studies, statements, verdicts. Nothing else imports it."""
