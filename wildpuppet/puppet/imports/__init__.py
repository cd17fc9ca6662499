"""Puppets from the files of other tools: one file per format, one table (``formats``), one kind of answer (``result``).

Every file is taken for hostile: sizes are looked at before anything is unpacked (``limits``), and what is refused is
refused in one line. What a format holds and a puppet cannot is told in the answer's notes, never dropped in silence.
"""
