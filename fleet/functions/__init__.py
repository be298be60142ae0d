"""Map() and Eval(): the contract, built-in extractors and evaluation parts, HTTP server and clients."""
