"""Specs that were damaged at random: each is planned or refused in words, quickly and in little memory."""
