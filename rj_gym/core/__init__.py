"""What every task shares: the environments around it, its episodes, its settings."""
