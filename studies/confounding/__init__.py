"""Study: association against intervention in a world where glasses stand next to plates."""
