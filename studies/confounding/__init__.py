"""Study: association against intervention where glasses stand beside plates."""
