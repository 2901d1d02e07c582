"""An independent simulator of elastic arms, and the small campaigns made with it.

`examples.arm` is the physics: torsion springs in the joints that balance a load exactly.
`examples.simulator` turns it into campaign documents as the service takes them.

Nothing here imports the numerical core, the messages or the service, nor pinocchio: what the tests
call truth must not come from the code under test. Only numpy is used.
"""
