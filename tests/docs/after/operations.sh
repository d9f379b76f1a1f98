# The copies: nobody but their owner may read any of them.
readable=$(find history-copy.db backups restored -type f -perm /077 2>/dev/null || true)
[[ -z $readable ]] || { echo "others may read these copies: $readable"; exit 1; }
