// Nothing: what counts is the memory barrier that follows every dispatch.
void main() {}
