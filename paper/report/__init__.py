"""How the study is shown: page, pictures, terminal."""
