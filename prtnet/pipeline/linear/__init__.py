"""The methods pca and cpca of a job: transfer as a weighted sum of a few vectors."""
