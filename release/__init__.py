# SPDX-License-Identifier: GPL-3.0-or-later
"""What users install: the extension's archives, built and checked (`make package`).

One archive serves all systems. Its wheels weigh 18 MB, of which a Blender needs 1 to 2. But who installs it
from disk has nothing to choose, and nothing to choose wrongly; and since its manifest names no platforms it
also installs where no wheel fits, and there reads and writes its files by Blender's own OpenImageIO. A
repository of extensions knows which Blender asks, so for one there is an archive for each system
(`--split-platforms`).

Blender refuses an extension with wheels where none is for its Python. For such a Blender there is an archive
without any (`--no-wheels`).
"""
